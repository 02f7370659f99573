# SPDX-License-Identifier: GPL-3.0-or-later
"""Corners of a level's coded voxels in ranges of planes, which bound the memory for sorting.

Corners are ordered plane by plane (z), line by line (y), x fastest, as `corner_rows.py` requires of codes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..cells.morton import morton_decode
from ..octree.octree import Octree
from .corner_rows import set_corner_rows

RANGE_VOXELS = 1 << 15  # around a range, unless one plane alone has more


def corner_ranges(
    octree: Octree, coded: np.ndarray, level: int, first: int, table: np.ndarray, most: int = RANGE_VOXELS
) -> Iterator[np.ndarray]:
    """Corners (C,) int64 of a level in order, numbers x + y side + z side^2 with side = 2^level + 1, by ranges.

    coded: (K,) all coded nodes. The rows of all corners, from `first` on, are written into the table (K, 3). A range
    has at most `most` coded voxels around it, or is a single plane. Raises SettingError for a line of more than 65,535
    corners.
    """
    side = (1 << level) + 1
    begin, end = np.searchsorted(coded, octree.level_start[level : level + 2])
    keys = octree.keys(level)[coded[begin:end] - octree.level_start[level]]
    voxels = morton_decode(keys) @ np.array([1, side, side**2])
    order = np.argsort(voxels)
    voxels, lines = voxels[order], begin + order
    before = np.searchsorted(voxels, np.arange(-1, side + 1) * side**2)  # voxels below the plane before each one
    low = 0
    while low < side:
        high = int(np.searchsorted(before, before[low] + most, side="right")) - 2
        high = min(max(high, low + 1), side)
        around = slice(before[low], before[high + 1])
        corners = _write_rows(voxels[around], lines[around], (low, high), side, first, table)
        if len(corners):
            yield corners
        first, low = first + len(corners), high


def _write_rows(
    voxels: np.ndarray, lines: np.ndarray, planes: tuple[int, int], side: int, first: int, table: np.ndarray
) -> np.ndarray:
    """Corners of voxels (V,) within planes, and their rows, from `first` on, in lines (V,) of the table."""
    low, high = planes[0] * side**2, planes[1] * side**2
    starts = []  # corners (0, y, z) of voxels, and their lines, for each y + 2 z
    for octant in range(4):
        corners = voxels + (octant & 1) * side + (octant >> 1) * side**2
        inside = (corners >= low) & (corners < high)
        starts.append((corners[inside], lines[inside]))
    every = np.concatenate([corners + x for corners, _ in starts for x in range(2)])
    every.sort(kind="stable")  # merges sorted runs
    every = every[np.diff(every, prepend=-1) > 0]
    for octant, (corners, of) in enumerate(starts):
        set_corner_rows(table, of, 2 * octant, first + np.searchsorted(every, corners))
    return every


def places_of(corners: np.ndarray, level: int) -> np.ndarray:
    """Corners (C, 3) int32 of a level by their numbers (C,)."""
    side = (1 << level) + 1
    return np.stack([corners % side, corners // side % side, corners // side**2], axis=1).astype(np.int32)
