# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of all numbers of the command line; names of outputs; frame lists such as 1-8x3."""

import argparse
from collections.abc import Iterator

import pytest

from patchnet import commands
from patchnet.patchnet_addon.runtime.bounds import Bounds
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.frames import parse_frames
from patchnet.training.commands import RESEARCH


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
    for program, action in actions(commands.make_parser(more=RESEARCH)):
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
        (["--max-samples", "100000000000"], "--max-samples 100000000000 is outside 2 to 65536"),
        (["--max-samples", "1.5"], "--max-samples '1.5' is not a whole number"),
        (["--size", "20000", "16"], "--size 20000 is outside 0 to 16384"),
        (["--out", ""], "--out is empty"),
    ):
        assert commands.main(["run", "scene.blend", *words]) == 2
        assert capsys.readouterr().err.startswith(f"patchnet: error: {said}")


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("7", (7,)),
        ("1-4", (1, 2, 3, 4)),
        ("1-8x3", (1, 4, 7)),
        ("1-8:3", (1, 4, 7)),  # as Open Job Description writes it
        ("9,1, 5", (1, 5, 9)),
        ("3-5,4,1-3", (1, 2, 3, 4, 5)),
        ("-2-1", (-2, -1, 0, 1)),
        ("-5--4", (-5, -4)),
        ("all", (10, 12)),
        ("ALL,11", (10, 11, 12)),
    ],
)
def test_frames(text: str, frames: tuple[int, ...]) -> None:
    assert parse_frames(text, range(10, 13, 2)) == frames


@pytest.mark.parametrize(
    ("text", "said"),
    [
        *((text, "cannot be read") for text in ("", "1-", "1,,2", "1.5", "1x2")),
        ("24-1", "before the first"),
        ("1-9x0", "at least 1"),
        ("1-999999999", "Blender's frames end"),
    ],
)
def test_texts_that_name_no_frames(text: str, said: str) -> None:
    with pytest.raises(SettingError, match=said):
        parse_frames(text, range(1, 3))
