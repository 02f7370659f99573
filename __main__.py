# SPDX-License-Identifier: GPL-3.0-or-later
"""The `patchnet` command, also `python -m patchnet`."""

import sys


def main() -> int:
    """Run the command line and return its exit code."""
    from .commands import main as run_command

    return run_command()


if __name__ == "__main__":
    sys.exit(main())
