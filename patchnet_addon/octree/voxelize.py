# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles -> surface sums per leaf cell: clip, shade, add up, batch by batch and block by block."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..progress import Progress, Steps
from .accumulate import LeafAccumulator
from .blocks import CellSet, Pass, all_cells, plan_passes, tasks_of, to_cells
from .clip import clip_triangles
from .grid import Grid
from .leaf_levels import LeafLevels
from .mesh import Fragments, MeshSource, Shade, TriangleBatch

Kept = TypeVar("Kept")

# Fragments whose leaves are added up at a time. A leaf takes about 75 bytes while that lasts, and 28 afterwards.
BLOCK_FRAGMENTS = 24_000_000


@dataclass(frozen=True, eq=False)
class LeafSums:
    """Surface integrals over the leaf cells of one level, in ascending order of their key.

    keys: (n,) uint64. sums: (n, 5) float32 or float64: area, area * luminance, area * normal (x, y, z), in world units
    and weighed by opacity.
    """

    level: int
    keys: np.ndarray
    sums: np.ndarray


def triangle_areas_and_normals(corners_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Areas (T,) and unit normals (T, 3) of triangles (T, 3, 3); degenerate ones get area 0."""
    edges = corners_world[:, 1:] - corners_world[:, :1]  # (T, 2, 3)
    cross = np.cross(edges[:, 0], edges[:, 1])
    length = np.sqrt((cross * cross).sum(axis=1))
    normals = cross / np.where(length > 0, length, 1.0)[:, None]
    return 0.5 * length, normals


def voxelize(
    source: MeshSource,
    grid: Grid,
    shade: Shade,
    keep: Callable[[list[LeafSums], int], Kept],
    *,
    layout: LeafLevels | None = None,
    block_fragments: int = BLOCK_FRAGMENTS,
) -> Steps[list[Kept]]:
    """Clip every triangle of `source` against the leaf cells and integrate what `shade` says of the pieces.

    layout: the leaves' levels, at most the grid's depth; None puts all on that.
    About `block_fragments` fragments are added up at a time; where there are more, the triangles are read again for
    each set of blocks of space, in Morton order. `keep` gets the leaves of each pass, level by level, coarse first, and
    the level of the blocks, and says what is kept of them. The leaves do not depend on the passes, nor on the order of
    triangles, as far as `shade` does not.
    """
    passes = plan_passes(source, grid, layout or LeafLevels.uniform(grid.depth), block_fragments)
    kept = []
    for number, chosen in enumerate(passes):
        leaves = yield from _leaves_of_pass(chosen, source, grid, shade, number, len(passes))
        kept.append(keep(leaves, chosen.layout.block_level))
    return kept


def all_leaves(leaves: list[LeafSums], _block_level: int) -> list[LeafSums]:
    """Keep everything, for `voxelize`."""
    return leaves


def _leaves_of_pass(
    chosen: Pass, source: MeshSource, grid: Grid, shade: Shade, number: int, count: int
) -> Steps[list[LeafSums]]:
    """Leaves of the blocks of pass `number` of `count`, level by level; progress counts the triangles of all passes."""
    cells = chosen.cells()
    leaves = {level: LeafAccumulator(grid.side_world / (1 << level)) for level in cells}
    done = number * source.triangle_count
    for batch in source.batches():
        areas, normals = triangle_areas_and_normals(batch.corners_world)
        for level, wanted in cells.items():
            for fragments in clip_batch(batch, grid, areas, level, wanted):
                luminance, opacity = shade(batch, fragments)
                leaves[level].add(fragments, luminance, opacity, normals)
        done += len(batch)
        yield Progress(done, count * source.triangle_count, "Voxelizing")
    return [LeafSums(level, *leaves.pop(level).take()) for level in cells if len(leaves[level])]


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def clip_batch(
    batch: TriangleBatch, grid: Grid, areas_world: np.ndarray, level: int, wanted: CellSet | None = None
) -> Iterator[Fragments]:
    """Fragments of a batch in the cells of a level, in groups of a few hundred thousand, in a fixed order, clipped on
    all cores."""
    corners_voxel = to_cells(batch.corners_world, grid, level)
    chosen = wanted or all_cells(level)
    workers, resolution = usable_cores(), 1 << level

    def clip(task: tuple[int, int, tuple[int, int]]) -> Fragments:
        return Fragments(*clip_triangles(corners_voxel, areas_world, *task, resolution, chosen.near, chosen.block))

    with ThreadPoolExecutor(workers) as pool:
        waiting = []
        for task in tasks_of(corners_voxel, resolution):
            waiting.append(pool.submit(clip, task))
            if len(waiting) > 2 * workers:  # bounded memory
                yield waiting.pop(0).result()
        for future in waiting:
            yield future.result()
