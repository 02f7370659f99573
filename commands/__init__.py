# SPDX-License-Identifier: GPL-3.0-or-later
"""Command line: `patchnet SUB-COMMAND`, one sub-command a file.

A sub-command NAME is the module `commands/NAME.py`, `patchnet lab NAME` the module `commands/lab/NAME.py`, a hyphen in
its name an underscore, with two functions:

    add_parser(subparsers) -> argparse.ArgumentParser    its arguments and help
    run(args) -> int                                     the work; the exit code

The modules are imported on every call, for the help: they import numba, torch and Blender inside functions only.
"""

import argparse
import importlib
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from types import ModuleType
from typing import NoReturn

# In the order of the help.
NAMES: tuple[str, ...] = ("run", "demo", "octree", "info", "export", "verify-light", "bench", "lab")

EXIT_UNEXPECTED = 1
EXIT_ERROR = 2


def main(
    argv: Sequence[str] | None = None,
    *,
    names: Iterable[str] | None = None,
    program: str = "patchnet",
    level: str = "WARNING",
) -> int:
    """Run the command line.

    `argv` are the arguments without the program's name, by default those of the process; `names` the sub-commands that
    there are, by default all; `level` what the log tells users. Returns the exit code: 0 for success, 2 for bad input
    (one sentence on stderr), 130 when interrupted, 143 by SIGTERM, and with a log for programs 1 for what should not
    have happened, which else is raised.
    """
    from ..patchnet_addon.runtime import log
    from ..patchnet_addon.runtime.errors import FileAccessError, PatchNetError
    from ..patchnet_addon.runtime.interrupt import exit_code_of, prompt_interrupt
    from .shared.lines import say_error

    words = sys.argv[1:] if argv is None else list(argv)
    modules = modules_of(names or NAMES)
    try:
        log.set_up(_log_format(words), level)
        args = make_parser(modules, program).parse_args(words)
        log.start(args.command, arguments=words)
        with prompt_interrupt():
            return int(modules[args.command].run(args))
    except PatchNetError as error:
        say_error(f"error: {error}", EXIT_ERROR)
        return EXIT_ERROR
    except KeyboardInterrupt as stop:
        say_error("interrupted", exit_code_of(stop))
        return exit_code_of(stop)
    except Exception as error:
        if isinstance(error, OSError) and (explained := FileAccessError.of(error)) is not None:
            say_error(f"error: {explained}", EXIT_ERROR)
            return EXIT_ERROR
        if not log.is_json():
            raise
        log.unexpected(error, exit_code=EXIT_UNEXPECTED)
        return EXIT_UNEXPECTED


def modules_of(names: Iterable[str] = NAMES) -> dict[str, ModuleType]:
    """Modules of sub-commands, by name."""
    return {name: importlib.import_module(f".{name.replace('-', '_')}", __name__) for name in names}


class _Parser(argparse.ArgumentParser):
    """Argument parser that says in one sentence what it does not understand, without its usage."""

    def error(self, message: str) -> NoReturn:
        from .shared.lines import say_error

        say_error(f"error: {message}; `{self.prog} --help` lists what there is", EXIT_ERROR)
        self.exit(EXIT_ERROR)


def make_parser(modules: dict[str, ModuleType], program: str = "patchnet") -> argparse.ArgumentParser:
    """Parser of the whole command line, with one sub-parser a module; docs/make_commands.py reads it."""
    from .shared.arguments import add_version

    parser = _Parser(prog=program, description="See where a coarse view of a scene is wrong, and refine there first.")
    add_version(parser)
    _add_log_format(parser)
    subparsers = parser.add_subparsers(dest="command", metavar="SUB-COMMAND", required=True)
    for module in modules.values():
        for each in _with_nested(module.add_parser(subparsers)):
            _add_log_format(each)
    return parser


def _with_nested(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser and those of its own sub-commands, as `bench` and `lab` have."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for nested in action.choices.values():
                yield from _with_nested(nested)


def _add_log_format(parser: argparse.ArgumentParser) -> None:
    from ..patchnet_addon.runtime.log import FORMATS, VARIABLE

    parser.add_argument(
        "--log-format", choices=FORMATS, default=argparse.SUPPRESS,
        help=f"stderr for users, or one JSON object a line for programs (the variable {VARIABLE}, else text)",
    )  # fmt: skip


def _log_format(words: Sequence[str]) -> str | None:
    """--log-format before anything else is understood, so that even misunderstandings are said in it."""
    from ..patchnet_addon.runtime.log import FORMATS

    given = [following for word, following in pairwise(words) if word == "--log-format"]
    given += [word.partition("=")[2] for word in words if word.startswith("--log-format=")]
    return next((text for text in given if text in FORMATS), None)
