# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batches: the occupied blocks around V voxels, and R views of each, optionally augmented.

Only occupied blocks are gathered. A corner's patch is eight blocks, each multiplied with its own slice of the first
matrix, so a batch lists which block meets which slice for which corner (see `corner_layer.py`). The kernels are serial,
since several threads gather, and learn from, a part of a step each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.kernels import kernel
from .forest import Forest
from .gathered_blocks import gather_blocks
from .nearby import Nearby, gather_nearby
from .samples import COVERAGE_SCALE, SIGNED, UNIT
from .symmetry import COUNT, Symmetries, cube_symmetries

PAIR_POSITION = np.array(
    [[sum(((c >> axis & 1) + (s >> axis & 1)) * 3**axis for axis in range(3)) for c in range(8)] for s in range(8)],
    np.int32,
)  # (slice, corner) -> block of the brick


@dataclass(frozen=True, eq=False)
class Batch:
    """V voxels with R views each.

    blocks: (M, B) float32, the occupied blocks of all voxels; cells z, y, x of occupancy, luminance, normal, B = 320
    for a look-ahead of two levels. For networks that mix luminances, which see shape alone, it is left out, B = 256.
    uint16 is the bits of bfloat16, for encoders whose products are of that type.
    slice_start: (9,) int64; pairs slice_start[s] to slice_start[s + 1] meet slice s (octant x + 2y + 4z of the patch).
    pair_block: (P,) int64 rows of `blocks`. pair_corner: (P,) int64 corner 8 v + c that the pair adds to.
    entry, direction, up: (V, R, 3) float32. ratio, coverage, luminance: (V, R) float32.
    nearby: for networks that mix luminances.
    """

    blocks: np.ndarray
    slice_start: np.ndarray
    pair_block: np.ndarray
    pair_corner: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray
    coverage: np.ndarray
    luminance: np.ndarray
    nearby: Nearby | None = field(default=None, kw_only=True)


@dataclass(frozen=True, eq=False)
class Augmentation:
    """Augmentation of each of V voxels.

    symmetry: (V,) int32 number of the cube symmetry, 0 for none.
    remap: (V, 4) float32: gain, place of the result in its free range [0, 1], 1 to invert, 1 to remap at all.
    """

    symmetry: np.ndarray
    remap: np.ndarray

    @classmethod
    def none(cls, count: int) -> Augmentation:
        """Leave `count` voxels as they are."""
        return cls(np.zeros(count, np.int32), np.zeros((count, 4), np.float32))

    @classmethod
    def random(cls, count: int, random: np.random.Generator, remap_share: float = 0.5) -> Augmentation:
        """Random symmetry for each voxel, and for a share of them another range of luminance (methods 7.20)."""
        remap = random.random((count, 4), np.float32)
        remap[:, 0] += 0.5
        remap[:, 2] = remap[:, 2] < 0.5
        remap[:, 3] = remap[:, 3] < remap_share
        return cls(random.integers(0, COUNT, count).astype(np.int32), remap)

    def part(self, first: int, last: int) -> Augmentation:
        """Augmentation of the voxels `first` to `last`, the last one excluded."""
        return Augmentation(self.symmetry[first:last], self.remap[first:last])


@cache
def _symmetries(lookahead: int) -> Symmetries:
    return cube_symmetries(lookahead)


def gather_batch(
    forest: Forest,
    tree: np.ndarray,
    voxel: np.ndarray,
    views: np.ndarray,
    augmentation: Augmentation,
    lookahead: int = DEFAULT_LOOKAHEAD,
    *,
    nearby: bool = False,
    narrow: bool = False,
) -> Batch:
    """Batch of voxels (V, 4) of octrees `tree` (V,) with their stored views (V, R, 12), drawn `lookahead` levels
    ahead; `nearby`: with the luminances that a mixture needs; `narrow`: with blocks in bits of bfloat16."""
    symmetries = _symmetries(lookahead)
    found = gather_blocks(
        forest,
        (tree, voxel),
        (augmentation.symmetry, augmentation.remap),
        symmetries,
        lookahead,
        luminance=not nearby,
        narrow=narrow,
    )
    start, pair_block, pair_corner = _list_pairs(found.moved, PAIR_POSITION)
    stored = _stored_views(views)
    moved_views = _move_views(stored, augmentation.symmetry, symmetries, found.linear)
    near = gather_nearby(forest, tree, found.around, stored[:4], found.linear) if nearby else None
    return Batch(found.rows, start, pair_block, pair_corner, *moved_views, nearby=near)


def _stored_views(views: np.ndarray) -> tuple[np.ndarray, ...]:
    """Entry, direction, up (V, R, 3), ratio, coverage, luminance (V, R), float32, of stored views (V, R, 12)."""
    vectors = [np.empty((*views.shape[:2], 3), np.float32) for _ in range(3)]
    numbers = [np.empty(views.shape[:2], np.float32) for _ in range(3)]
    _read_views(views, *vectors, *numbers)
    return *vectors, *numbers


def _move_views(
    stored: tuple[np.ndarray, ...], symmetry: np.ndarray, symmetries: Symmetries, linear: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Entry, direction, up, ratio, coverage, luminance of stored views after the augmentation."""
    *vectors, ratio, coverage, luminance = stored
    moved = tuple(np.empty_like(vector) for vector in vectors)
    _turn_views(tuple(vectors), symmetries.axis[symmetry], symmetries.sign[symmetry], moved)
    return *moved, ratio, coverage, luminance * linear[:, None, 0] + linear[:, None, 1]


@kernel
def _read_views(views, entry, direction, up, ratio, coverage, luminance):
    unit, signed = np.float32(UNIT), np.float32(SIGNED)
    for v in range(views.shape[0]):
        for r in range(views.shape[1]):
            for axis in range(3):
                entry[v, r, axis] = np.float32(views[v, r, axis]) / unit
                direction[v, r, axis] = np.float32(np.int16(views[v, r, 3 + axis])) / signed
                up[v, r, axis] = np.float32(np.int16(views[v, r, 6 + axis])) / signed
            ratio[v, r] = np.float32(views[v, r, 9]) / unit
            coverage[v, r] = np.float32(views[v, r, 10]) / np.float32(COVERAGE_SCALE)
            luminance[v, r] = np.float32(views[v, r, 11]) / unit


@kernel
def _turn_views(vectors, axis, sign, moved):
    entry, direction, up = vectors
    moved_entry, moved_direction, moved_up = moved
    half = np.float32(0.5)
    for v in range(entry.shape[0]):
        for r in range(entry.shape[1]):
            for k in range(3):
                source, s = axis[v, k], sign[v, k]
                moved_entry[v, r, k] = s * (entry[v, r, source] - half) + half
                moved_direction[v, r, k] = s * direction[v, r, source]
                moved_up[v, r, k] = s * up[v, r, source]


@kernel
def _list_pairs(moved, position):
    start = np.zeros(9, np.int64)
    total = 0
    for v in range(len(moved)):
        for s in range(8):
            for c in range(8):
                total += moved[v, position[s, c]] >= 0
    pair_block, pair_corner = np.empty(total, np.int64), np.empty(total, np.int64)
    at = 0
    for s in range(8):
        for v in range(len(moved)):
            for c in range(8):
                row = moved[v, position[s, c]]
                if row >= 0:
                    pair_block[at] = row
                    pair_corner[at] = 8 * v + c
                    at += 1
        start[s + 1] = at
    return start, pair_block, pair_corner
