# SPDX-License-Identifier: GPL-3.0-or-later
"""Frame lists of an animation: "1-24", "1-24x2", "1,5,9", "all"."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from .errors import PatchNetError, SettingError

ALL = "all"
LAST_FRAME = 1_048_574  # Blender's last frame; its first is the negative
_PART = re.compile(r"(-?\d+)(?:-(-?\d+)(?:[x:](\d+))?)?")


def parse_frames(text: str, of_scene: range | None = None) -> tuple[int, ...]:
    """Parse a list of frames: each once, in ascending order.

    of_scene: frames of "all"; None where unknown, then "all" is empty. Raises SettingError.
    """
    frames: set[int] = set()
    for part in (part.strip() for part in text.split(",")):
        if part.lower() == ALL:
            frames.update(of_scene or ())
        else:
            frames.update(_part(part, text))
    return tuple(sorted(frames))


def frame_range(first: int, last: int, step: int = 1) -> range:
    """Frames from `first` to `last`, both inclusive; raises SettingError if there is none."""
    if step < 1:
        raise SettingError(f"A frame step of {step} is too small: give at least 1")
    if last < first:
        raise SettingError(f"Frames {first} to {last} are none: the last frame comes before the first")
    if max(-first, last) > LAST_FRAME:
        raise SettingError(f"Frames {first} to {last} reach beyond {LAST_FRAME:,}, where Blender's frames end")
    return range(first, last + 1, step)


@contextmanager
def errors_of_frame(frame: int) -> Iterator[None]:
    """Prefix errors within the block with the frame number."""
    try:
        yield
    except PatchNetError as error:
        raise type(error)(f"Frame {frame}: {error}") from error


def _part(part: str, text: str) -> range:
    match = _PART.fullmatch(part)
    if match is None:
        raise SettingError(f"Frames '{text}' cannot be read: write 1-24, 1-24x2, 1,5,9 or {ALL}")
    first, last, step = match.groups()
    return frame_range(int(first), int(first if last is None else last), int(step or 1))
