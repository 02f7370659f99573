# SPDX-License-Identifier: GPL-3.0-or-later
"""Crops of pictures, found by rule: where one refined picture is nearer to the truth than another by most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Crop:
    """Square of `side` pixels in a picture; row and column are those of its first pixel, row 0 is the lowest."""

    row: int
    column: int
    side: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of the square in a picture."""
        return slice(self.row, self.row + self.side), slice(self.column, self.column + self.side)


def window_sums(values: np.ndarray, side: int) -> np.ndarray:
    """Sums (H - side + 1, W - side + 1) float64 of all squares in `values` (H, W)."""
    total = np.pad(np.asarray(values, np.float64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    return total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]


def crops_of_difference(error: np.ndarray, other: np.ndarray, side: int) -> tuple[Crop, Crop]:
    """Two squares that do not overlap: where errors (H, W) are below `other` by most, and where above by most.

    The second is found beside the first. side: in pixels, at most half of the picture's.
    """
    gain = window_sums(np.asarray(other, np.float64) - error, side)
    first = _at(int(np.argmax(gain)), gain.shape, side)
    rows, columns = np.ogrid[: gain.shape[0], : gain.shape[1]]
    beside = np.maximum(abs(rows - first.row), abs(columns - first.column)) >= side
    second = _at(int(np.argmin(np.where(beside, gain, np.inf))), gain.shape, side)
    return first, second


def _at(index: int, shape: tuple[int, ...], side: int) -> Crop:
    row, column = divmod(index, shape[1])
    return Crop(row, column, side)
