# SPDX-License-Identifier: GPL-3.0-or-later
"""Level-of-detail contract (methods 4.1b): the voxel that fits a pixel, and whether it has look-ahead.

Sides are in the octree's cube, where a voxel of level l has side 2^-l. Tracing, depths and fitted octrees all use it;
the functions named `..._of` are the references, for arrays.
"""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device
from .morton import POPCOUNT

MAX_LEVELS = 24  # of any walk down an octree
MIN_RATIO, MAX_RATIO = 0.5, 1.0  # range of pixel side / voxel side of the network (methods 7.8)


@device
def fits_pixel(voxel_side, pixel_side):
    """Return whether a voxel that a ray enters stops it: its side is below two pixel sides there."""
    return voxel_side < 2.0 * pixel_side


@device
def fitting_level(pixel_side):
    """First level whose voxels fit a pixel of that side, at most MAX_LEVELS."""
    level = 0
    size = 1.0
    while not fits_pixel(size, pixel_side) and level < MAX_LEVELS:
        size *= 0.5
        level += 1
    return level


def fitting_level_of(pixel_side: np.ndarray | float) -> np.ndarray:
    """Levels (N,) float64, whole numbers, as `fitting_level` without the limit; also its reference."""
    levels: np.ndarray = np.maximum(np.floor(-np.log2(2.0 * np.asarray(pixel_side))) + 1, 0)
    return levels


@device
def pixel_voxel_ratio(pixel_side, voxels_per_side):
    """Pixel side over voxel side, clamped to the network's range; voxels_per_side: 2^level (methods 7.8)."""
    return min(max(pixel_side * voxels_per_side, MIN_RATIO), MAX_RATIO)


@device
def has_lookahead(child_mask, first_child, node, lookahead):
    """Return whether `node` has descendants `lookahead` levels down; the compiled form of `Octree.look_ahead`.

    Children of consecutive nodes are consecutive, so a node's descendants on a level are one run of nodes.
    """
    first = np.int64(node)
    last = first
    for _ in range(lookahead):
        below_first = np.int64(-1)
        below_last = np.int64(-1)
        for here in range(first, last + 1):
            mask = child_mask[here]
            if mask != 0:
                if below_first < 0:
                    below_first = np.int64(first_child[here])
                below_last = np.int64(first_child[here]) + np.int64(POPCOUNT[mask]) - 1
        if below_first < 0:
            return False
        first = below_first
        last = below_last
    return True
