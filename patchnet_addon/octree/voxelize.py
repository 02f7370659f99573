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
from .blocks import BlockSet, all_blocks, plan_blocks, tasks_of, to_voxels
from .clip import clip_triangles
from .grid import Grid
from .mesh import Fragments, MeshSource, Shade, TriangleBatch

# Fragments whose leaves are added up at a time. A leaf takes about 75 bytes while that lasts, and 28 afterwards.
BLOCK_FRAGMENTS = 24_000_000


@dataclass(frozen=True, eq=False)
class LeafSums:
    """Surface integrals over leaf cells, in ascending order of their key.

    keys: (n,) uint64. sums: (n, 5) float32 or float64: area, area * luminance, area * normal (x, y, z), in world units
    and weighed by opacity.
    """

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
    source: MeshSource, grid: Grid, shade: Shade, *, block_fragments: int = BLOCK_FRAGMENTS
) -> Steps[LeafSums]:
    """Clip every triangle of `source` against the leaf grid and integrate what `shade` says of the pieces.

    About `block_fragments` fragments are added up at a time; where there are more, the triangles are read again for
    each block of space. The result does not depend on that, nor on the order of triangles, as far as `shade` does not.
    Raises GeometryError when no opaque surface is left.
    """
    blocks = plan_blocks(source, grid, block_fragments)
    parts = []
    for number, block in enumerate(blocks):
        leaves = LeafAccumulator(grid)
        done = number * source.triangle_count
        for batch in source.batches():
            areas, normals = triangle_areas_and_normals(batch.corners_world)
            for fragments in clip_batch(batch, grid, areas, block):
                luminance, opacity = shade(batch, fragments)
                leaves.add(fragments, luminance, opacity, normals)
            done += len(batch)
            yield Progress(done, len(blocks) * source.triangle_count, "Voxelizing")
        if len(leaves):
            parts.append(leaves.take())
    if not parts:
        raise GeometryError(
            "No opaque surface is left to voxelize: all triangles have zero area or are fully transparent"
        )
    return _joined(parts)


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> LeafSums:
    """Sums of consecutive blocks; each block is let go as soon as it is copied."""
    if len(parts) == 1:
        return LeafSums(*parts[0])
    count = sum(len(keys) for keys, _ in parts)
    keys, sums = np.empty(count, np.uint64), np.empty((count, 5), parts[0][1].dtype)
    start = 0
    while parts:
        part_keys, part_sums = parts.pop(0)
        keys[start : start + len(part_keys)] = part_keys
        sums[start : start + len(part_keys)] = part_sums
        start += len(part_keys)
    return LeafSums(keys, sums)


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def clip_batch(
    batch: TriangleBatch, grid: Grid, areas_world: np.ndarray, block: BlockSet | None = None
) -> Iterator[Fragments]:
    """Fragments of a batch in groups of a few hundred thousand, in a fixed order, clipped on all cores."""
    corners_voxel = to_voxels(batch.corners_world, grid)
    chosen = block or all_blocks(grid)
    workers = usable_cores()

    def clip(task: tuple[int, int, int, int]) -> Fragments:
        return Fragments(
            *clip_triangles(corners_voxel, areas_world, *task, grid.resolution, chosen.wanted, chosen.shift)
        )

    with ThreadPoolExecutor(workers) as pool:
        waiting = []
        for task in tasks_of(corners_voxel, grid.resolution):
            waiting.append(pool.submit(clip, task))
            if len(waiting) > 2 * workers:  # bounded memory
                yield waiting.pop(0).result()
        for future in waiting:
            yield future.result()
