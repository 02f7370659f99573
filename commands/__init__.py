# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: `patchnet SUB-COMMAND`, one sub-command a file.

A sub-command NAME is the module `commands/NAME.py`, a hyphen in its name an underscore, with two functions:

    add_parser(subparsers) -> argparse.ArgumentParser    its arguments and help
    run(args) -> int                                     the work; the exit code

The modules are imported on every call, for the help: they import numba, torch and Blender inside functions only.
"""

import argparse
import importlib
import sys
from collections.abc import Sequence
from types import ModuleType

# In the order of the help.
NAMES: tuple[str, ...] = ("run", "demo", "info", "octree", "export", "verify-light", "dataset", "train", "bench")

EXIT_ERROR = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    `argv` are the arguments without the program's name, by default those of the process. Returns the exit code:
    0 for success, 2 for bad input (one sentence on stderr), 130 when interrupted.
    """
    from ..patchnet_addon.errors import PatchNetError
    from ..patchnet_addon.interrupt import INTERRUPTED, prompt_interrupt

    modules = {name: importlib.import_module(f".{name.replace('-', '_')}", __name__) for name in NAMES}
    args = _parser(modules).parse_args(argv)
    try:
        with prompt_interrupt():
            return int(modules[args.command].run(args))
    except PatchNetError as error:
        print(f"patchnet: error: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print("patchnet: interrupted", file=sys.stderr)
        return INTERRUPTED


def _parser(modules: dict[str, ModuleType]) -> argparse.ArgumentParser:
    """The parser of the whole command line, with one sub-parser a module."""
    parser = argparse.ArgumentParser(
        prog="patchnet",
        description="See where a coarse view of a scene is wrong, and refine there first.",
    )
    subparsers = parser.add_subparsers(dest="command", metavar="SUB-COMMAND", required=True)
    for module in modules.values():
        module.add_parser(subparsers)
    return parser
