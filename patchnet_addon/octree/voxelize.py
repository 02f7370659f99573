# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles -> surface sums per leaf cell: clip, shade, add up, batch by batch and block by block."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..errors import GeometryError
from ..progress import Progress, Steps
from .accumulate import LeafAccumulator
from .blocks import CellSet, Pass, all_cells, plan_passes, tasks_of, to_cells
from .clip import clip_triangles
from .grid import Grid
from .leaf_levels import LeafLevels
from .mesh import Fragments, MeshSource, Shade, TriangleBatch

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
    *,
    layout: LeafLevels | None = None,
    block_fragments: int = BLOCK_FRAGMENTS,
) -> Steps[list[LeafSums]]:
    """Clip every triangle of `source` against the leaf cells and integrate what `shade` says of the pieces.

    layout: the leaves' levels, at most the grid's depth; None puts all on that. The result has one entry for each level
    with leaves, coarse first.
    About `block_fragments` fragments are added up at a time; where there are more, the triangles are read again for
    each block of space. The result does not depend on that, nor on the order of triangles, as far as `shade` does not.
    Raises GeometryError when no opaque surface is left.
    """
    passes = plan_passes(source, grid, layout or LeafLevels.uniform(grid.depth), block_fragments)
    parts: dict[int, list[LeafSums]] = {}
    for number, chosen in enumerate(passes):
        made = leaves_of_pass(chosen, source, grid, shade, number, len(passes))
        for part in (yield from made):
            parts.setdefault(part.level, []).append(part)
    if not parts:
        raise GeometryError(
            "No opaque surface is left to voxelize: all triangles have zero area or are fully transparent"
        )
    return [_joined(level, parts.pop(level)) for level in sorted(parts)]


def leaves_of_pass(
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


def _joined(level: int, parts: list[LeafSums]) -> LeafSums:
    """Sums of consecutive blocks; each block is let go as soon as it is copied."""
    if len(parts) == 1:
        return parts[0]
    count = sum(len(part.keys) for part in parts)
    keys, sums = np.empty(count, np.uint64), np.empty((count, 5), parts[0].sums.dtype)
    start = 0
    while parts:
        part = parts.pop(0)
        end = start + len(part.keys)
        keys[start:end], sums[start:end] = part.keys, part.sums
        start = end
    return LeafSums(level, keys, sums)


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
