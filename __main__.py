# SPDX-License-Identifier: GPL-3.0-or-later
"""The `patchnet` command, also `python -m patchnet`."""

import os
import sys
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line and end the process with its exit code."""
    from .commands import main as run_command

    leave(run_command())


def leave(code: int) -> NoReturn:
    """End the process with `code`.

    Blender as a Python module can wait forever while its library is unloaded: a thread of its own still waits on what
    is being destroyed. So once it is loaded, the process ends as soon as everything is written.
    """
    if "bpy" not in sys.modules:
        sys.exit(code)
    import atexit

    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
