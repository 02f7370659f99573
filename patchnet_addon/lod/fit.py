# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera-fitted octrees: leaves as deep as a set of cameras needs for look-ahead, and coarse elsewhere (methods 4.1b).

Each round renders the present octree through all cameras. Where a ray hits, leaves become as deep as its pixel needs,
but only two levels deeper per round: coarse voxels extend before the surface and hide surface behind, so that their
requests are estimates, which the next round corrects. Light does not matter, opacity does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..octree.grid import Grid
from ..octree.leaf_levels import LeafLevels
from ..octree.levels import hierarchy
from ..octree.nodes import Nodes
from ..octree.voxelize import LeafSums, voxelize
from ..runtime.bounds import DEFAULT_LOOKAHEAD, MAX_DEPTH
from ..runtime.errors import GeometryError
from ..runtime.kernels import kernel
from ..runtime.progress import Steps, labelled
from ..surface.mesh import MeshSource, ShadingFn
from ..tracing.camera import Camera
from .detail import lookahead_share, needed_levels

BLOCK_LEVEL = 8  # also the level of invisible leaves
LAYOUT_BYTES = 16 * 8**BLOCK_LEVEL  # data of each block, and further data of fitting
LEVELS_PER_ROUND = 2
_COARSER = 2  # distance of rays in levels of pixels, in all but the last round: a block covers many pixels
LABEL = "Fitting to the cameras"


@dataclass(frozen=True, eq=False)
class FittedLevels:
    """Levels of the leaves, and their limit.

    wanted: deepest level that the cameras need. leaves: approximate number of leaves. lookahead_share: share of hit
    pixels with look-ahead in the camera with the smallest share; 1 without a limit, if leaves are as deep as all
    cameras need.
    """

    layout: LeafLevels
    wanted: int
    leaves: int
    lookahead_share: float


def fit_leaf_levels(
    source: MeshSource,
    grid: Grid,
    cameras: Sequence[Camera],
    shade: ShadingFn,
    *,
    max_leaves: float = np.inf,
    deepest: int = MAX_DEPTH,
    lookahead: int = DEFAULT_LOOKAHEAD,
) -> Steps[FittedLevels]:
    """Levels of leaves with look-ahead wherever `cameras` see the surface, within the cube of `grid`.

    shade: provides opacity. max_leaves: above this number leaves become coarser, first in blocks with the fewest pixels
    per leaf. lookahead: levels, of the weights in use. Raises GeometryError without opaque surface.
    """
    block_level = min(BLOCK_LEVEL, deepest)
    grid = replace(grid, depth=deepest)
    layout = LeafLevels.uniform(block_level, block_level)
    leaves = yield from _leaf_keys(source, grid, layout, shade)
    if not leaves:
        raise GeometryError("No opaque surface is left to voxelize: all triangles are fully transparent")
    surface = leaves[block_level]
    needed, last = np.zeros(len(surface), np.uint8), False
    for cap in _caps(block_level, deepest):
        seen, pixels = yield from _look(leaves, grid, cameras, layout, lookahead, coarser=0 if last else _COARSER)
        # The last round renders the finest leaves and their gaps: it only adds requests.
        needed = np.maximum(needed, seen[surface]) if last else seen[surface]
        wanted = layout.levels.copy()
        wanted[surface] = np.clip(needed, block_level, cap)
        finer, expected = _within(LeafLevels(wanted), pixels, leaves, max_leaves)
        if last:
            break
        leaves = yield from _changed(leaves, layout, finer, source, grid, shade)
        layout = finer
        last = needed.max(initial=0) <= cap or cap == deepest
    fitted = FittedLevels(finer, wanted=int(needed.max(initial=block_level)), leaves=expected, lookahead_share=1.0)
    if (finer.levels[surface] >= needed).all():
        return fitted
    leaves = yield from _changed(leaves, layout, finer, source, grid, shade)
    nodes = Nodes(*hierarchy(leaves, max(leaves)))
    share = min((lookahead_share(nodes, grid, camera, lookahead=lookahead) for camera in cameras), default=1.0)
    return replace(fitted, leaves=sum(len(keys) for keys in leaves.values()), lookahead_share=share)


def _caps(block_level: int, deepest: int) -> Iterator[int]:
    """Deepest leaves of each round; the last cap is for the last round, too."""
    yield from range(block_level + LEVELS_PER_ROUND, deepest, LEVELS_PER_ROUND)
    yield deepest
    yield deepest


def _changed(
    leaves: dict[int, np.ndarray],
    before: LeafLevels,
    after: LeafLevels,
    source: MeshSource,
    grid: Grid,
    shade: ShadingFn,
) -> Steps[dict[int, np.ndarray]]:
    """Keys of the leaves of `after`, given `leaves` of `before`; recomputes only changed blocks."""
    different = before.levels != after.levels
    if not different.any():
        return leaves
    kept = {
        level: keys[~different[keys >> np.uint64(3 * (level - before.block_level))]] for level, keys in leaves.items()
    }
    made = yield from _leaf_keys(source, grid, LeafLevels(np.where(different, after.levels, np.uint8(0))), shade)
    together = {level: _merged(kept.get(level), made.get(level)) for level in {*kept, *made}}
    return {level: keys for level, keys in together.items() if len(keys)}


def _look(
    leaves: dict[int, np.ndarray],
    grid: Grid,
    cameras: Sequence[Camera],
    layout: LeafLevels,
    lookahead: int,
    *,
    coarser: int,
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Levels (blocks,) uint8 that all cameras request where they see the present leaves.

    With them: number of pixels (blocks,) uint32 that show each block. coarser: levels by which rays are farther apart
    than pixels; they request the levels of pixels.
    """
    needed, pixels = np.zeros(len(layout.levels), np.uint8), np.zeros(len(layout.levels), np.uint32)
    nodes = Nodes(*hierarchy(leaves, max(leaves)))
    for camera in cameras:
        apart = camera.with_size(*(max(side >> coarser, 1) for side in (camera.width_px, camera.height_px)))
        steps = needed_levels(nodes, grid, apart, needed, pixels, lookahead=lookahead, coarser=coarser)
        yield from labelled(steps, f"{LABEL}: {camera.name}")
    return needed, pixels


def _within(
    layout: LeafLevels, pixels: np.ndarray, leaves: dict[int, np.ndarray], max_leaves: float
) -> tuple[LeafLevels, int]:
    """Layout, or one with at most about `max_leaves`: a level less in the blocks with the fewest pixels per leaf.

    With it, the approximate number of leaves. A level deeper, a block has four times its present `leaves`.
    """
    expected = np.zeros(len(layout.levels), np.float32)
    for level, keys in leaves.items():
        _add_expected(keys, level, np.uint64(3 * (level - layout.block_level)), layout.levels, expected)
    levels = layout.levels.copy()
    while (excess := expected.sum(dtype=np.float64) - max_leaves) > 0:
        deep = np.flatnonzero((expected > 0) & (levels > layout.block_level))
        if len(deep) == 0:
            break
        deep = deep[np.argsort(pixels[deep] / expected[deep], kind="stable")]
        gain = np.cumsum(0.75 * expected[deep], dtype=np.float64)
        lowered = deep[: np.searchsorted(gain, excess) + 1]
        levels[lowered] -= 1
        expected[lowered] *= 0.25
    return LeafLevels(levels), round(expected.sum(dtype=np.float64))


def _leaf_keys(source: MeshSource, grid: Grid, layout: LeafLevels, shade: ShadingFn) -> Steps[dict[int, np.ndarray]]:
    """Ascending keys of the leaves on each level."""
    steps = voxelize(source, grid, shade, _keys_of, layout=layout, only_keys=True)
    passes = yield from labelled(steps, LABEL)
    levels = sorted({level for keys in passes for level in keys})
    return {level: np.concatenate([keys[level] for keys in passes if level in keys]) for level in levels}


def _keys_of(leaves: list[LeafSums], _block_level: int) -> dict[int, np.ndarray]:
    return {part.level: part.keys for part in leaves}


@kernel
def _add_expected(keys, level, shift, levels, expected):  # type: ignore[no-untyped-def]
    """Add to `expected` (blocks,) the number of leaves that each leaf of `level` becomes at its block's level."""
    for key in keys:
        block = key >> shift
        expected[block] += 4.0 ** (np.int64(levels[block]) - level)


def _merged(first: np.ndarray | None, second: np.ndarray | None) -> np.ndarray:
    """Ascending union of two disjoint arrays of keys."""
    both = np.concatenate([keys for keys in (first, second) if keys is not None])
    both.sort(kind="stable")  # merges two sorted runs
    return both
