# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray frame: axes of the octree, mirrored and swapped so that a ray travels up all three, most along the first.

All 48 symmetries of the cube map to this frame, in which cells of lower numbers hide those of higher ones. So a network
need not learn each orientation separately (methods 11.2).
"""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np

from ..runtime.kernels import device

FRAMES = 48
SIDE = 4  # cells along a side of the renumbered blocks
CELLS = SIDE**3

_PERMUTATIONS = np.array(list(itertools.permutations(range(3))))  # number 2 a + (b > c) is (a, b, c)


@cache
def cell_order() -> np.ndarray:
    """Number (48, 64) int64 in each ray frame of the cells x + 4 y + 16 z of a 4x4x4 block."""
    cells = np.stack([np.arange(CELLS) // SIDE**axis % SIDE for axis in range(3)], axis=-1)  # (64, 3)
    order = np.empty((FRAMES, CELLS), np.int64)
    for number, axes in enumerate(_PERMUTATIONS):
        for flips in range(8):
            mirrored = np.where(flips >> np.arange(3) & 1 == 1, SIDE - 1 - cells, cells)
            order[8 * number + flips] = mirrored[:, axes] @ np.array([1, SIDE, SIDE**2])
    return order


@device
def ray_frame(x, y, z):
    """Number of the frame of a direction, and its three axes."""
    a, b, c = 0, 1, 2
    first, second, third = abs(x), abs(y), abs(z)
    if first < second:
        a, b, first, second = b, a, second, first
    if second < third:
        b, c, second, third = c, b, third, second
    if first < second:
        a, b = b, a
    number = 8 * (2 * a + (1 if b > c else 0))
    return number + (1 if x < 0 else 0) + (2 if y < 0 else 0) + (4 if z < 0 else 0), (a, b, c)
