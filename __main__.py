# SPDX-License-Identifier: GPL-3.0-or-later
"""Entry point of the `patchnet` command, also `python -m patchnet`."""

import os
import sys
import traceback
from contextlib import suppress
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    _open_closed_streams()
    try:
        code = _run()
    except KeyboardInterrupt:  # before or after the work
        code = 130
        with suppress(OSError):  # Ctrl-C has ended who reads stderr, too
            print("patchnet: interrupted", file=sys.stderr)
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

    from .operators.scene_access.temporary import session_folder_goes
    from .patchnet_addon.runtime.replace import remove_unfinished

    session_folder_goes()
    atexit._run_exitfuncs()
    remove_unfinished()
    os._exit(code)


if __name__ == "__main__":
    main()
