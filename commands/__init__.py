# SPDX-License-Identifier: GPL-3.0-or-later
"""Command line: `patchnet SUB-COMMAND`, one sub-command per file.

A sub-command NAME is the module `commands/NAME.py`; a hyphen in its name becomes an underscore. Its docstring is the
help, and it has two functions:

    add_arguments(parser)    its arguments
    run(args) -> int         the work; the exit code

The help of every call imports the modules: they import numba, torch and Blender inside functions only.
"""

import argparse
import importlib
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NoReturn

# Short helps, in the order of the help.
NAMES = {
    "run": "refine the views of a scene where a coarse picture is wrong",
    "fly-through": "light a scene once and render all frames of a moving camera",
    "demo": "build the demo courtyard and show what PatchNet does with it",
    "octree": "voxelize and light a scene",
    "info": "print what an octree, codes or weights file holds",
    "export": "write the voxels of an octree as .ply, .vdb or .safetensors",
    "verify-light": "compare the light in the voxels with Cycles",
}

EXIT_UNEXPECTED = 1
EXIT_ERROR = 2


def main(
    argv: Sequence[str] | None = None,
    *,
    program: str = "patchnet",
    level: str = "WARNING",
    more: Mapping[str, Mapping[str, str]] = MappingProxyType({}),
) -> int:
    """Run the command line.

    argv: arguments without the program's name (those of the process). level: lowest level of log messages shown to
    users. more: short helps of sub-commands of other packages. Returns the exit code: 0 for success, 2 for bad input
    (one sentence on stderr), and with a JSON log 1 for an unexpected error, which is raised otherwise.
    """
    from ..patchnet_addon.runtime import log
    from ..patchnet_addon.runtime.errors import FileAccessError, PatchNetError
    from .shared.lines import say_error

    words = sys.argv[1:] if argv is None else list(argv)
    try:
        log.set_up(_log_format(words), level)
        args = make_parser(program, more).parse_args(words)
        args.words = words
        log.start(args.command, arguments=words)
        return int(args.run(args))
    except PatchNetError as error:
        say_error(f"error: {error}", EXIT_ERROR)
        return EXIT_ERROR
    except Exception as error:
        if isinstance(error, OSError) and (explained := FileAccessError.of(error)) is not None:
            say_error(f"error: {explained}", EXIT_ERROR)
            return EXIT_ERROR
        if not log.is_json():
            raise
        log.unexpected(error, exit_code=EXIT_UNEXPECTED)
        return EXIT_UNEXPECTED


class _Parser(argparse.ArgumentParser):
    """Argument parser whose errors are one sentence without the usage."""

    def error(self, message: str) -> NoReturn:
        from .shared.lines import say_error

        say_error(f"error: {message}; `{self.prog} --help` lists the arguments", EXIT_ERROR)
        self.exit(EXIT_ERROR)


def make_parser(
    program: str = "patchnet", more: Mapping[str, Mapping[str, str]] = MappingProxyType({})
) -> argparse.ArgumentParser:
    """Parser of the command line; docs/make_commands.py reads it."""
    from .shared.arguments import add_version

    parser = _Parser(prog=program, description="See where a coarse view of a scene is wrong, and refine there first.")
    add_version(parser)
    add_log_format(parser)
    subparsers = parser.add_subparsers(dest="command", metavar="SUB-COMMAND", required=True)
    add_commands(subparsers, __name__, NAMES)
    for package, helps in more.items():
        add_commands(subparsers, package, helps)
    return parser


def add_commands(subparsers: "argparse._SubParsersAction[Any]", package: str, helps: Mapping[str, str]) -> None:
    """Add a parser for each named module of a package, with its short help."""
    for name, text in helps.items():
        module = importlib.import_module(f"{package}.{name.replace('-', '_')}")
        single = subparsers.add_parser(
            name, help=text, description=module.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        add_log_format(single)
        if hasattr(module, "run"):
            single.set_defaults(run=module.run)
        module.add_arguments(single)


def add_log_format(parser: argparse.ArgumentParser) -> None:
    """Add the argument --log-format."""
    from ..patchnet_addon.runtime.log import FORMATS, VARIABLE

    parser.add_argument(
        "--log-format", choices=FORMATS, default=argparse.SUPPRESS,
        help=f"stderr for users, or one JSON object a line for programs (the variable {VARIABLE}, else text)",
    )  # fmt: skip


def _log_format(words: Sequence[str]) -> str | None:
    """Value of --log-format before parsing, so that parsing errors follow it, too."""
    from ..patchnet_addon.runtime.log import FORMATS

    given = [following for word, following in pairwise(words) if word == "--log-format"]
    given += [word.partition("=")[2] for word in words if word.startswith("--log-format=")]
    return next((text for text in given if text in FORMATS), None)
