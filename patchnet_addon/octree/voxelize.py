# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles -> surface sums per leaf cell: clip, shade, reduce, batch by batch."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..errors import GeometryError
from ..kernels import serial_kernel
from ..progress import Progress, Steps
from .clip import clip_triangles
from .grid import Grid
from .mesh import Fragments, MeshSource, Shade, TriangleBatch

_FRAGMENTS_PER_TASK = 1 << 18
_PENDING_ROWS = 12_000_000
_MIN_OPACITY = 1.0 / 255.0


@dataclass(frozen=True, eq=False)
class LeafSums:
    """Surface integrals over leaf cells, in ascending order of their key.

    keys: (n,) uint64. sums: (n, 5) float64: area, area * luminance, area * normal (x, y, z), weighed by opacity.
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


def voxelize(source: MeshSource, grid: Grid, shade: Shade) -> Steps[LeafSums]:
    """Clip every triangle of `source` against the leaf grid and integrate what `shade` says of the pieces.

    Raises GeometryError when no opaque surface is left.
    """
    pending: list[LeafSums] = []
    rows = 0
    done = 0
    for batch in source.batches():
        areas, normals = triangle_areas_and_normals(batch.corners_world)
        for fragments in clip_batch(batch, grid, areas):
            luminance, opacity = shade(batch, fragments)
            part = _reduce_fragments(fragments, luminance, opacity, normals)
            pending.append(part)
            rows += len(part.keys)
            if rows > _PENDING_ROWS and len(pending) > 1:
                pending = [merge_sums(pending)]
                rows = len(pending[0].keys) // 2  # so that merging stays linear in the long run
        done += len(batch)
        yield Progress(done, source.triangle_count, "Voxelizing")
    sums = merge_sums(pending) if pending else LeafSums(np.empty(0, np.uint64), np.empty((0, 5)))
    if len(sums.keys) == 0:
        raise GeometryError(
            "No opaque surface is left to voxelize: all triangles have zero area or are fully transparent"
        )
    return sums


def clip_batch(batch: TriangleBatch, grid: Grid, areas_world: np.ndarray) -> Iterator[Fragments]:
    """Fragments of a batch in groups of a few hundred thousand, in a fixed order, clipped on all cores."""
    corners_voxel = (batch.corners_world - np.asarray(grid.origin_world)) / grid.voxel_world
    tasks = _tasks(corners_voxel, grid.resolution)
    workers = os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:

        def clip(task: tuple[int, int, int, int]) -> Fragments:
            return Fragments(*clip_triangles(corners_voxel, areas_world, *task, grid.resolution))

        waiting = []
        for task in tasks:
            waiting.append(pool.submit(clip, task))
            if len(waiting) > 2 * workers:  # bounded memory
                yield waiting.pop(0).result()
        for future in waiting:
            yield future.result()


def _tasks(corners_voxel: np.ndarray, resolution: int) -> Iterator[tuple[int, int, int, int]]:
    """Ranges (first, last, x_first, x_last) of similar work; one huge triangle is divided along x."""
    extent = np.ptp(corners_voxel, axis=1) + 1.0  # (T, 3) cells
    work = extent.prod(axis=1) / extent.max(axis=1) + 1.0  # a plane through the box, about
    ends = np.cumsum(work)
    first = 0
    while first < len(work):
        before = ends[first - 1] if first else 0.0
        last = max(first + 1, int(np.searchsorted(ends, before + _FRAGMENTS_PER_TASK, side="right")))
        if last == first + 1 and work[first] > 2 * _FRAGMENTS_PER_TASK:
            pieces = int(np.ceil(work[first] / _FRAGMENTS_PER_TASK))
            low, high = np.clip(
                np.floor([corners_voxel[first, :, 0].min(), corners_voxel[first, :, 0].max()]), 0, resolution - 1
            )
            cuts = np.unique(np.linspace(low, high + 1, pieces + 1).astype(int))
            for x_first, x_last in pairwise(cuts):
                yield first, last, int(x_first), int(x_last)
        else:
            yield first, last, 0, resolution
        first = last


def _reduce_fragments(
    fragments: Fragments, luminance: np.ndarray, opacity: np.ndarray, normals: np.ndarray
) -> LeafSums:
    order = np.argsort(fragments.keys, kind="stable")
    keys, sums, count = _sum_fragments(
        order, fragments.keys, fragments.triangle, fragments.area_world,
        np.asarray(luminance, np.float32), np.asarray(opacity, np.float32), normals, np.float64(_MIN_OPACITY),
    )  # fmt: skip
    return LeafSums(keys[:count].copy(), sums[:count].copy())


@serial_kernel
def _sum_fragments(order, keys, triangle, area, luminance, opacity, normals, min_opacity):  # type: ignore[no-untyped-def]
    out_keys = np.empty(len(order), np.uint64)
    sums = np.zeros((len(order), 5), np.float64)
    count = 0
    for index in order:
        if opacity[index] < min_opacity:
            continue
        if count == 0 or out_keys[count - 1] != keys[index]:
            out_keys[count] = keys[index]
            count += 1
        weight = area[index] * opacity[index]
        row = sums[count - 1]
        row[0] += weight
        row[1] += weight * luminance[index]
        for axis in range(3):
            row[2 + axis] += weight * normals[triangle[index], axis]
    return out_keys, sums, count


def merge_sums(parts: list[LeafSums]) -> LeafSums:
    """Sums of several parts, added where their keys agree."""
    if len(parts) == 1:
        return parts[0]
    keys = np.concatenate([part.keys for part in parts])
    sums = np.concatenate([part.sums for part in parts])
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]])) if len(keys) else np.empty(0, np.int64)
    if len(starts) == 0:
        return LeafSums(keys, sums)
    return LeafSums(keys[starts], np.add.reduceat(sums[order], starts, axis=0))
