# SPDX-License-Identifier: GPL-3.0-or-later
"""Entry point of the `patchnet` command, also `python -m patchnet`."""

import os
import sys
import traceback
from contextlib import suppress
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    try:
        code = _run()
    except KeyboardInterrupt:  # before or after the work
        print("patchnet: interrupted", file=sys.stderr)
        code = 130
    except SystemExit as stop:  # argparse: help, or words that it does not know
        code = stop.code if isinstance(stop.code, int) else 1
    except Exception as error:  # noqa: BLE001  it is shown in full, and the process ends as below
        code = 2 if _is_lost_output(error) else 1
        with suppress(OSError):
            traceback.print_exc()
    leave(code)


def _is_lost_output(error: Exception) -> bool:
    """Return whether stdout or stderr could not be written, as on a full disk; see `streams.py`."""
    return isinstance(error, OSError) and error.filename in ("stdout", "stderr")


def _run() -> int:
    from .patchnet_addon.runtime.streams import keep_streams
    from .training.commands import main as run_command

    keep_streams()
    return run_command()


def leave(code: int) -> NoReturn:
    """End the process with `code`.

    Blender as a Python module can wait forever while its library is unloaded: a thread of its own still waits on what
    is being destroyed. So once it is loaded, the process ends as soon as everything is written, and what Blender would
    have tidied up is.
    """
    from .patchnet_addon.runtime.streams import finish_streams

    if (error := finish_streams()) is not None and not code:
        code = 2
        print(f"patchnet: error: what was printed is lost ({error.strerror})", file=sys.stderr)
    if "bpy" not in sys.modules:
        sys.exit(code)
    import atexit

    from .operators.scene_access.temporary import session_folder_goes
    from .patchnet_addon.runtime.replace import remove_unfinished

    session_folder_goes()
    atexit._run_exitfuncs()
    remove_unfinished()
    finish_streams()
    os._exit(code)


if __name__ == "__main__":
    main()
