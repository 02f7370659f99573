# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of `clip`: clip every cell of a triangle's bounding box on its own; fragments in order, one by one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.surface.mesh import Fragments, TriangleBatch
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals


def parts_of(clipped: ClippedSurface) -> Iterator[tuple[TriangleBatch, Fragments]]:
    """All fragments, batch by batch."""
    for number, ranges in enumerate(clipped.passes):
        cells = [blocks.cells() for blocks in ranges]
        for batch in clipped.source.batches():
            areas, _ = triangle_areas_and_normals(batch.corners_world)
            for share, wanted in enumerate(cells, number * len(ranges)):
                for fragments in clipped.fragments(share, batch, areas, wanted):
                    yield batch, fragments


def each_fragment(clipped: ClippedSurface) -> Iterator[tuple[TriangleBatch, Fragments, int, int, int]]:
    """Fragments one by one: batch, its fragments, number, key and triangle of one among all."""
    for batch, fragments in parts_of(clipped):
        for f in range(len(fragments)):
            yield batch, fragments, f, int(fragments.keys[f]), batch.first_triangle + int(fragments.triangle[f])


def centroids(corners: np.ndarray, fragments: Fragments) -> np.ndarray:
    """Centroids (F, 3) float64 of fragments of triangles (T, 3, 3)."""
    own, weights = corners[fragments.triangle], fragments.barycentric[..., None].astype(np.float64)
    return np.asarray(own[:, 0] + (weights * (own[:, 1:] - own[:, :1])).sum(axis=1))


def clip_reference(corners_voxel: np.ndarray, resolution: int) -> dict[int, tuple[float, np.ndarray]]:
    """Cells that one triangle (3, 3), in leaf cells, shares area with.

    Returns {Morton key: (share of the triangle's area, centroid as weights (2,) of its last two corners)}.
    A piece that lies in a face between two cells belongs to the upper one (half-open cells).
    """
    low = np.clip(np.floor(corners_voxel.min(axis=0)).astype(int), 0, resolution - 1)
    high = np.clip(np.floor(corners_voxel.max(axis=0)).astype(int), 0, resolution - 1)
    pieces = {}
    for cell, polygon in _cells_of(_whole(corners_voxel), low, high):
        area, centroid = area_and_centroid(np.array([weights[1:] for _, weights in polygon]))
        upper_face = any(
            polygon and cell[axis] < high[axis] and all(point[axis] == cell[axis] + 1 for point, _ in polygon)
            for axis in range(3)
        )
        if area > 0 and not upper_face:
            pieces[int(morton_encode(np.array([cell]))[0])] = (2.0 * area, centroid)
    return pieces


def piece_reference(corners_voxel: np.ndarray, cell: tuple[int, ...]) -> list:
    """Part of a triangle (3, 3) in one cell: vertices as pairs of position (3,) and barycentric weights (3,)."""
    polygon = _whole(corners_voxel)
    for axis in range(3):
        polygon = _slab(polygon, axis, cell[axis])
    return polygon


def _whole(corners_voxel: np.ndarray) -> list:
    return list(zip(corners_voxel, np.eye(3), strict=True))


def _slab(polygon: list, axis: int, cell: int) -> list:
    return half_space(half_space(polygon, axis, cell, +1.0), axis, cell + 1, -1.0)


def _cells_of(polygon: list, low: np.ndarray, high: np.ndarray) -> Iterator[tuple[tuple[int, ...], list]]:
    """Cells from `low` to `high` that a polygon touches, and its part in each, cut axis by axis."""
    for x in range(low[0], high[0] + 1):
        in_x = _slab(polygon, 0, x)
        for y in range(low[1], high[1] + 1) if in_x else ():
            in_xy = _slab(in_x, 1, y)
            for z in range(low[2], high[2] + 1) if in_xy else ():
                yield (x, y, z), _slab(in_xy, 2, z)


def area_and_centroid(points: np.ndarray) -> tuple[float, np.ndarray]:
    """Area and centroid (2,) of a convex polygon (n, 2)."""
    if len(points) < 3:
        return 0.0, np.zeros(2)
    around = points[1:] - points[0]
    cross = np.abs(around[:-1, 0] * around[1:, 1] - around[1:, 0] * around[:-1, 1])
    moment, total = (cross[:, None] * (around[:-1] + around[1:])).sum(axis=0) / 3.0, float(cross.sum())
    return 0.5 * total, points[0] + (moment / total if total > 0.0 else 0.0)


def half_space(polygon: list, axis: int, plane: float, sign: float) -> list:
    """Part of the polygon with sign * (coordinate - plane) >= 0 (Sutherland and Hodgman)."""
    kept = []
    for (a, wa), (b, wb) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        da, db = sign * (a[axis] - plane), sign * (b[axis] - plane)
        if da >= 0:
            kept.append((a, wa))
        if (da < 0 < db) or (db < 0 < da):
            t = da / (da - db)
            point = a + t * (b - a)
            point[axis] = plane
            kept.append((point, wa + t * (wb - wa)))
    return kept
