# SPDX-License-Identifier: GPL-3.0-or-later
"""Widths of integers: counts that arrays of 32 bits could not hold are refused before anything wraps around."""

from __future__ import annotations

from .errors import SettingError

INT32_COUNT = 2**31  # numbers from 0 on that an int32 has
UINT32_COUNT = 2**32
NODE_ADVICE = "choose a smaller depth, or voxelize fewer objects"


def check_count(count: int, most: int, what: str, advice: str) -> None:
    """Raise SettingError that names `what` there is too much of and says what to do, for more than `most`."""
    if count > most:
        bits = 31 if most <= INT32_COUNT else 32
        raise SettingError(f"{count:,} {what} are more than numbers of {bits} bits can name ({most:,}): {advice}")
