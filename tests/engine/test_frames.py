# SPDX-License-Identifier: GPL-3.0-or-later
"""Parse frame lists such as 1-8x3."""

import pytest

from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.frames import parse_frames


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
