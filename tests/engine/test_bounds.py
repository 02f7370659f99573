# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of all numbers of the command line; names of outputs."""

import argparse
from collections.abc import Iterator

import pytest

from patchnet import commands
from patchnet.patchnet_addon.runtime.bounds import Bounds
from patchnet.patchnet_addon.runtime.errors import SettingError


def actions(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.Action]]:
    """All arguments of a parser and of the sub-commands below it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from actions(below)
        else:
            yield parser.prog, action


def numbers() -> Iterator[tuple[str, argparse.Action]]:
    """Those that take a number: their type is `Bounds.read`."""
    for program, action in actions(commands.make_parser()):
        assert action.type not in (int, float), f"{program} {action.option_strings} has no bounds"
        if isinstance(getattr(getattr(action.type, "func", None), "__self__", None), Bounds):
            yield f"{program} {action.option_strings[0]}", action


NUMBERS = dict(numbers())


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_outside_their_bounds_are_refused_by_name(name: str) -> None:
    action = NUMBERS[name]
    row, read = action.type.func.__self__, action.type
    wrong = ["nan", "inf", "-inf", "1e400", "9" * 5000, "many", "", *(["1.5"] if row.whole else [])]
    wrong += [str(row.low - 1 - abs(row.low)), str(2 * row.high + 1)]
    for text in wrong:
        with pytest.raises(SettingError, match=f"^{action.option_strings[0]} .*is (outside|not a)"):
            read(text)
    for value in (row.low, row.high):
        assert read(str(int(value) if row.whole else value)) == value
    if action.default is not None:
        for value in action.default if isinstance(action.default, list | tuple) else [action.default]:
            row.check(value)


def test_refusal_is_a_sentence_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    for words, said in (
        (["--memory", "nan"], "--memory nan is outside 0.001 to 1048576"),
        (["--samples", "100000000000"], "--samples 100000000000 is outside 1 to 65536"),
        (["--samples", "1.5"], "--samples '1.5' is not a whole number"),
        (["--size", "20000", "16"], "--size 20000 is outside 0 to 16384"),
        (["--out", ""], "--out is empty"),
    ):
        assert commands.main(["run", "scene.blend", *words]) == 2
        assert capsys.readouterr().err.startswith(f"patchnet: error: {said}")
