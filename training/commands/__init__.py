# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole command line: sub-commands of users, and those of research, each a module of this folder."""

from collections.abc import Sequence

from ...commands import main as run_command

# Short helps, in the order of the help.
NAMES = {
    "check-scenes": "compare the light of random scenes with Cycles",
    "bench": "measure against other programs",
    "lab": "research: train networks, compare strategies, draw figures",
}
RESEARCH = {__name__: NAMES}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line as `patchnet.commands.main`; argv: arguments without the program's name (the process's)."""
    return run_command(argv, more=RESEARCH)
