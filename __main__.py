# SPDX-License-Identifier: GPL-3.0-or-later
"""Entry point of the `patchnet` command, also `python -m patchnet`."""

import os
import signal
import sys
import traceback
from contextlib import suppress
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line and end the process with its exit code.

    Ctrl-C ends it at once, also within a call into Blender, which may take minutes: what is finished is on disk.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where it is ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    _open_closed_streams()
    try:
        code = _run()
    except SystemExit as stop:  # argparse: help, or words that it does not know
        code = stop.code if isinstance(stop.code, int) else 1
    except BrokenPipeError:  # `| head`
        code = 1
    except Exception:  # noqa: BLE001  it is shown in full, and the process ends as below
        code = 1
        with suppress(OSError):
            traceback.print_exc()
    leave(code)


def _open_closed_streams() -> None:
    """Open what a shell closed (`>&-`): the first file would get its number, and what Blender prints."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _run() -> int:
    from .training.commands import main as run_command

    return run_command()


def leave(code: int) -> NoReturn:
    """End the process with `code`, or with 1 if its output cannot be written.

    Blender as a Python module can wait forever while its library is unloaded: a thread of its own still waits on what
    is being destroyed. So once it is loaded, the process ends as soon as everything is written, and what Blender would
    have tidied up is.
    """
    from .patchnet_addon.runtime.streams import drop_output

    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except OSError as error:
        code = code or 1
        drop_output(error)
    if "bpy" not in sys.modules:
        sys.exit(code)
    import atexit

    from .operators.scene_access.temporary import remove_session_folder

    atexit._run_exitfuncs()
    remove_session_folder()
    os._exit(code)


if __name__ == "__main__":
    main()
