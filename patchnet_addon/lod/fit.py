# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera-fitted octrees: leaves as deep as a set of cameras needs for look-ahead, and coarse elsewhere (methods 4.1b).

Each round renders the present octree through all cameras. Where a ray hits, leaves become as deep as its pixel needs,
but only two levels deeper per round: coarse voxels extend before the surface and hide surface behind, so that their
requests are estimates, which the next round corrects. Light does not matter, opacity does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..cells.morton_kernels import cell_key
from ..octree.accumulate import LeafSums
from ..octree.grid import Grid
from ..octree.leaf_levels import LeafLevels
from ..octree.levels import hierarchy
from ..octree.octree import Nodes, without_boxes
from ..octree.voxelize import ClippedSurface, LeafDetail, voxelize
from ..runtime.bounds import DEFAULT_LOOKAHEAD, MAX_DEPTH, MOST_STILLS
from ..runtime.errors import GeometryError
from ..runtime.kernels import kernel
from ..runtime.progress import Progress, Steps, labelled
from ..surface.mesh import MeshSource, ShadingFn
from ..tracing.camera import Camera, camera_in_unit_cube
from .fitted_levels import BLOCK_LEVEL, FittedLevels
from .ray_rows import rows_apart
from .stops import FINE_OFFSETS, RayStops, bands_of, ray_stops

LEVELS_PER_ROUND = 2
_COARSER = 2  # distance of rays in levels of pixels, in all but the last round: a block covers many pixels
LABEL = "Fitting to the cameras"

_BANDS_PER_STEP = 8


def needed_levels(
    nodes: Nodes,
    grid: Grid,
    camera: Camera,
    needed: np.ndarray,
    pixels: np.ndarray,
    *,
    bands: range | None = None,
    lookahead: int = DEFAULT_LOOKAHEAD,
    coarser: int = 0,
    fine_offsets: Sequence[tuple[float, float]] = FINE_OFFSETS,
) -> Steps[None]:
    """Raise `needed` (8^b,) uint8, by block of level b, to the level of leaves for look-ahead where rays hit.

    pixels: (8^b,) uint32, increased by the number of pixels whose centre ray stops in each block.

    nodes: of the present octree. bands: rows of tiles that have rays, None for all. lookahead: levels, of the weights
    in use. A pixel's centre ray requests the level for the voxel that stops it and for its neighbours, which are in its
    patches; rays with the footprint of the patch's voxels request it for their own hits, and so for surface in the gaps
    of the coarse picture. coarser: levels by which the camera's pixels are coarser than those with look-ahead, whose
    footprints rays have. fine_offsets: of the latter rays from the pixels' centres, in pixels.
    """
    unit = camera_in_unit_cube(camera, grid)
    block_level = (len(needed).bit_length() - 1) // 3
    bands = bands_of(0, 1, camera.height_px) if bands is None else bands
    for first in range(0, len(bands), _BANDS_PER_STEP):
        some = bands[first : first + _BANDS_PER_STEP]
        for offset, levels, margin in [((0.0, 0.0), 0, 1), *((offset, lookahead, 0) for offset in fine_offsets)]:
            stops = ray_stops(nodes, unit, some, offset, levels + coarser, lookahead + coarser)
            _request(stops, margin, block_level, needed)
            if margin:
                _count(stops, block_level, pixels)
        yield Progress(first + len(some), len(bands), "Finding detail")


def lookahead_share(nodes: Nodes, grid: Grid, camera: Camera, *, lookahead: int = DEFAULT_LOOKAHEAD) -> float:
    """Share of the pixels that hit the octree whose voxel has descendants `lookahead` levels down; 1 without hits."""
    unit = camera_in_unit_cube(camera, grid)
    stops = ray_stops(nodes, unit, bands_of(0, 1, camera.height_px), (0.0, 0.0), 0, lookahead)
    return float(stops.ahead[stops.wanted > 0].mean()) if (stops.wanted > 0).any() else 1.0


@kernel
def _request(stops: RayStops, margin: int, block_level: int, needed: np.ndarray) -> None:
    """Raise `needed` in all blocks that a cell meets, or one of those `margin` cells around it."""
    blocks = np.int64(1) << block_level
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for ray in range(len(stops.wanted)):
        if stops.wanted[ray] <= block_level:  # a miss, or the coarsest leaves suffice
            continue
        deeper = np.int64(stops.level[ray]) - block_level
        for axis in range(3):
            first = np.int64(stops.cell[ray, axis]) - margin
            last = np.int64(stops.cell[ray, axis]) + margin
            if deeper >= 0:
                first, last = first >> deeper, last >> deeper
            else:
                first, last = first << -deeper, ((last + 1) << -deeper) - 1
            low[axis] = max(first, 0)
            high[axis] = min(last, blocks - 1)
        for z in range(low[2], high[2] + 1):
            for y in range(low[1], high[1] + 1):
                for x in range(low[0], high[0] + 1):
                    block = cell_key(x, y, z)
                    needed[block] = max(needed[block], stops.wanted[ray])


@kernel
def _count(stops: RayStops, block_level: int, pixels: np.ndarray) -> None:
    """Add one to the block of each cell; a cell larger than a block counts in its first one."""
    for ray in range(len(stops.wanted)):
        if stops.wanted[ray] == 0:
            continue
        deeper = np.int64(stops.level[ray]) - block_level
        x, y, z = np.int64(stops.cell[ray, 0]), np.int64(stops.cell[ray, 1]), np.int64(stops.cell[ray, 2])
        if deeper >= 0:
            block = cell_key(x >> deeper, y >> deeper, z >> deeper)
        else:
            block = cell_key(x, y, z) << np.uint64(-3 * deeper)
        pixels[block] += np.uint32(1)


def fit_leaf_levels(
    source: MeshSource,
    grid: Grid,
    cameras: Sequence[Camera],
    shade: ShadingFn,
    *,
    max_leaves: float = np.inf,
    deepest: int = MAX_DEPTH,
    lookahead: int = DEFAULT_LOOKAHEAD,
    rough: bool = False,
) -> Steps[FittedLevels]:
    """Levels of leaves with look-ahead wherever `cameras` see the surface, within the cube of `grid`.

    shade: provides opacity. max_leaves: above this number leaves become coarser, first in blocks with the fewest pixels
    per leaf. lookahead: levels, of the weights in use. rough: an estimate by the first round alone, of about two thirds
    of the leaves. Raises GeometryError without opaque surface.
    """
    block_level = min(BLOCK_LEVEL, deepest)
    grid = replace(grid, depth=deepest)
    layout = LeafLevels.uniform(block_level, block_level)
    leaves = yield from leaf_keys_of(ClippedSurface(source, grid, layout, keep_bytes=0), shade)
    if not leaves:
        raise GeometryError("No opaque surface is left to voxelize: all triangles are fully transparent")
    surface = leaves[block_level]
    needed, last = np.zeros(len(surface), np.uint8), False
    for cap in (deepest,) if rough else _caps(block_level, deepest):
        seen, pixels = yield from _look(leaves, grid, cameras, layout, lookahead, coarser=0 if last else _COARSER)
        # The last round renders the finest leaves and their gaps: it only adds requests.
        needed = np.maximum(needed, seen[surface]) if last else seen[surface]
        wanted = layout.levels.copy()
        wanted[surface] = np.clip(needed, block_level, cap)
        finer, expected = _within(LeafLevels(wanted), pixels, leaves, max_leaves)
        if last or rough:
            break
        leaves = yield from _changed(leaves, layout, finer, source, grid, shade)
        layout = finer
        last = needed.max(initial=0) <= cap or cap == deepest
    short, seen_by = finer.levels[surface] < needed, pixels[surface]
    share = 1.0 - float(seen_by[short].sum() / seen_by.sum()) if seen_by.any() else None
    fitted = FittedLevels(finer, int(needed.max(initial=block_level)), expected, share)
    if rough or not short.any():
        return fitted
    leaves = yield from _changed(leaves, layout, finer, source, grid, shade)
    nodes = without_boxes(*hierarchy(leaves, max(leaves)))
    some = cameras[:: rows_apart(len(cameras))]  # as many rays as in a round
    share = min((lookahead_share(nodes, grid, camera, lookahead=lookahead) for camera in some), default=1.0)
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
    changed = LeafLevels(np.where(different, after.levels, np.uint8(0)))
    made = yield from leaf_keys_of(ClippedSurface(source, grid, changed, keep_bytes=0), shade)
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
    nodes = without_boxes(*hierarchy(leaves, max(leaves)))
    for number, camera in enumerate(cameras):
        offsets = FINE_OFFSETS if len(cameras) <= MOST_STILLS else (FINE_OFFSETS[number % len(FINE_OFFSETS)],)
        apart = camera.with_size(*(max(side >> coarser, 1) for side in (camera.width_px, camera.height_px)))
        bands = bands_of(number, len(cameras), apart.height_px)
        steps = needed_levels(
            nodes, grid, apart, needed, pixels, bands=bands, lookahead=lookahead, coarser=coarser, fine_offsets=offsets
        )
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


def leaf_keys_of(clipped: ClippedSurface, shade: ShadingFn) -> Steps[dict[int, np.ndarray]]:
    """Ascending keys of the leaves on each level."""
    return _keys((yield from labelled(_leaves_by_level(clipped, shade), LABEL)))


def _leaves_by_level(clipped: ClippedSurface, shade: ShadingFn) -> Steps[dict[int, list[LeafSums]]]:
    """Leaves on each level, coarse first, of the parts of space in order."""
    parts = yield from voxelize(clipped, shade, lambda leaves, _: leaves, detail=LeafDetail(only_keys=True))
    levels = sorted({part.level for leaves in parts for part in leaves})
    return {level: [part for leaves in parts for part in leaves if part.level == level] for level in levels}


def _keys(by_level: dict[int, list[LeafSums]]) -> dict[int, np.ndarray]:
    return {level: np.concatenate([part.keys for part in own]) for level, own in by_level.items()}


class Leaves(NamedTuple):
    """Leaves of an octree: their ascending keys by level, and its nodes with the boxes of the finest ones."""

    keys: dict[int, np.ndarray]
    nodes: Nodes


def leaves_of(clipped: ClippedSurface, shade: ShadingFn) -> Steps[Leaves]:
    """Leaves of a surface."""
    by_level = yield from _leaves_by_level(clipped, shade)
    if not by_level:
        raise GeometryError("No opaque surface is left to voxelize: all triangles are fully transparent")
    keys, depth = _keys(by_level), max(by_level)
    boxes = np.concatenate([part.boxes for part in by_level[depth] if part.boxes is not None])
    child_mask, first_child = hierarchy(keys, depth)
    return Leaves(keys, Nodes(child_mask, first_child, len(child_mask) - len(boxes), boxes))


@kernel
def _add_expected(keys: np.ndarray, level: int, shift: np.uint64, levels: np.ndarray, expected: np.ndarray) -> None:
    """Add to `expected` (blocks,) the number of leaves that each leaf of `level` becomes at its block's level."""
    for key in keys:
        block = key >> shift
        expected[block] += 4.0 ** (np.int64(levels[block]) - level)


def _merged(first: np.ndarray | None, second: np.ndarray | None) -> np.ndarray:
    """Ascending union of two disjoint arrays of keys."""
    both = np.concatenate([keys for keys in (first, second) if keys is not None])
    both.sort(kind="stable")  # merges two sorted runs
    return both
