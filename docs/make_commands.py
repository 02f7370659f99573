# SPDX-License-Identifier: GPL-3.0-or-later
"""Make commands.md from the parsers of the command line.

    python docs/make_commands.py

Sub-commands, arguments and helps come from the parsers. tests/blender/test_docs.py fails if the page is outdated.
"""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

from patchnet.commands import NAMES as IN_BLENDER
from patchnet.commands import make_parser
from patchnet.training.commands import RESEARCH

PAGE = Path(__file__).with_name("commands.md")
HEAD = """\
# Commands

With this page you can look up every argument of every command. It is made by `docs/make_commands.py` from the commands
themselves: change them there, then run it.

What the arguments of `run` mean, output files, animations and exit codes: [command-line.md](command-line.md).
Sub-commands marked yes also run as `blender --command patchnet`: [batch.md](batch.md#the-command-in-blender).
"""


def parsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Parsers of a parser's sub-commands, by name."""
    found = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(found[0].choices) if found else {}


def helps(parser: argparse.ArgumentParser) -> dict[str, str]:
    """Short helps of a parser's sub-commands, by name."""
    found = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return {choice.dest: choice.help or "" for choice in found[0]._choices_actions} if found else {}


def spelled(action: argparse.Action) -> str:
    """An argument with its values as users type it."""
    if not action.option_strings:
        name = action.metavar if isinstance(action.metavar, str) else action.dest
        return f"`{name.upper()}`" + (" (may be left out)" if action.nargs in ("?", "*") else "")
    names = ", ".join(f"`{name}`" for name in action.option_strings)
    if action.nargs == 0:
        return names
    if isinstance(action.metavar, tuple):
        value = " ".join(action.metavar)
    elif action.metavar is not None:
        value = action.metavar
    elif action.choices is not None:
        value = "|".join(str(choice) for choice in action.choices)
    else:
        value = action.dest.upper()
    more = " ..." if action.nargs in ("+", "*") else ""
    value = value.replace("|", "\\|")
    return f"{names} `{value}{more}`"


def explained(action: argparse.Action, program: str) -> str:
    """Help of an argument, as in --help, as a cell of a table."""
    formatter = argparse.HelpFormatter(program)
    text = formatter._expand_help(action) if action.help else ""
    if action.required and action.option_strings:
        text = f"{text} (required)"
    return _as_cell(text)


def _as_cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def arguments(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Arguments of a parser as a table, without those of all parsers."""
    rows = []
    for action in parser._actions:
        common = action.dest in ("help", "log_format") or isinstance(action, argparse._SubParsersAction)
        if not common and action.help != argparse.SUPPRESS:
            rows.append(f"| {spelled(action)} | {explained(action, parser.prog)} |")
    if rows:
        yield "| argument | what it is |"
        yield "|---|---|"
        yield from rows
        yield ""


def description(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Description of a parser, wrapped: the first paragraph of its docstring."""
    first = (parser.description or "").strip().split("\n\n", 1)[0]
    text = re.sub(r"^`?patchnet [^:]*:\s*", "", " ".join(first.split()))
    text = text[:1].upper() + text[1:]
    if text:
        yield from textwrap.wrap(text, 120, break_long_words=False, break_on_hyphens=False)
        yield ""


def section(name: str, parser: argparse.ArgumentParser, depth: int, also: str) -> Iterator[str]:
    """Section of a sub-command and its own sub-commands."""
    yield f"{'#' * depth} `{name}`"
    yield ""
    yield from description(parser)
    if also:
        yield also
        yield ""
    yield from arguments(parser)
    for below, child in parsers(parser).items():
        yield from section(f"{name} {below}", child, depth + 1, "")


def page() -> str:
    """The whole page."""
    parser = make_parser(more=RESEARCH)
    lines = [HEAD, "| sub-command | what it does | in Blender |", "|---|---|---|"]
    for name, text in helps(parser).items():
        lines.append(f"| [`{name}`](#{name}) | {_as_cell(text)} | {'yes' if name in IN_BLENDER else 'no'} |")
    lines += [
        "",
        "All sub-commands have `--help`, and `--log-format text` or `json`: [JSON lines](batch.md#json-lines).",
        "`patchnet --version` prints the versions for a bug report.",
        "",
    ]
    for name, child in parsers(parser).items():
        also = f"Also `blender --command patchnet {name}`." if name in IN_BLENDER else ""
        lines += section(name, child, 2, also)
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write commands.md beside this file."""
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
