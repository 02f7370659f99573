# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoised atlas: texels as points on the surface, averaged with each other, and put back (methods 7.2g)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..runtime.threads import run_parts
from ..surface.mesh import MeshSource, TriangleBatch
from ..surface.textures import TextureTable
from .atlas import COLOR_CHANNELS, MIN_OPACITY, Atlas
from .base_colors import base_colors
from .chart_lookup import texel_owners
from .charts import Charts
from .denoise import REACH, Cells, Texels, denoise
from .packing import SINGLE
from .texel_places import BatchTexels, texel_places

_LEAST_ALBEDO = 0.02  # darker base colours count as this, and such texels mix with each other only
_AXIS_BITS, _AXIS_CELLS = 19, 1 << 19


class Placed(NamedTuple):
    """Texels of one batch that are denoised, and their places in the atlas.

    albedo: (n, C), which is divided out. area: (n,) float32 of the surface that each is the texel of.
    """

    place: np.ndarray
    albedo: np.ndarray
    area: np.ndarray
    texels: Texels


def denoised_atlas(atlas: Atlas, source: MeshSource) -> Atlas:
    """Atlas whose texels are averaged with those around them that show the same light; one without `noise` stays.

    Emitters keep their own light: what they shine with has no noise.
    """
    if atlas.noise is None:
        return atlas
    index, albedo, _, texels = placed_texels(atlas, source)
    if not len(index):
        return replace(atlas, noise=None)
    order, cells = cells_of(texels.points, texels.size, atlas.charts.texel_world, np.zeros(3))
    found = denoise(Texels(*(np.ascontiguousarray(column[order]) for column in texels)), cells)
    index, albedo = index[order], albedo[order]
    values = atlas.texels.copy()
    columns = [0, 2, 3] if albedo.shape[1] > 1 else [0]
    values[index[:, None], columns] = found * albedo * values[index, 1:2]
    return replace(atlas, texels=values, noise=None)


def placed_texels(atlas: Atlas, source: MeshSource) -> Placed:
    """Texels of an atlas with `noise` that are denoised: all that met a surface and do not emit, in any order."""
    table = TextureTable.from_materials(source.materials, color=atlas.texels.shape[1] == COLOR_CHANNELS)
    parts = list(_placed(atlas, source, table, *_owned(atlas.charts)))
    if not parts:
        none = np.empty(0, np.float32)
        return Placed(np.empty(0, np.int64), none.reshape(0, 1), none, Texels(*(none,) * len(Texels._fields)))
    place, albedo, area = (np.concatenate([part[column] for part in parts]) for column in range(3))
    texels = Texels(*(np.concatenate(column) for column in zip(*(part.texels for part in parts), strict=True)))
    return Placed(place, albedo, area, texels)


def _owned(charts: Charts) -> tuple[np.ndarray, np.ndarray]:
    """Texels (n,) int64 of the atlas that belong to triangles, and these (n,) int32, in the order of triangles."""
    side = charts.page_side**2
    owners = [texel_owners(charts, page) for page in range(charts.page_count)]
    index = np.concatenate([np.flatnonzero(own >= 0) + page * side for page, own in enumerate(owners)])
    triangle = np.concatenate([own[own >= 0] for own in owners])
    order = np.argsort(triangle, kind="stable")
    return index[order], triangle[order]


def _placed(
    atlas: Atlas, source: MeshSource, table: TextureTable, index: np.ndarray, triangle: np.ndarray
) -> Iterator[Placed]:
    """Place the texels `index` of triangles (n,), ascending, batch by batch."""
    charts, noise = atlas.charts, atlas.noise
    assert noise is not None
    for batch in source.batches():
        first, last = np.searchsorted(triangle, [batch.first_triangle, batch.first_triangle + len(batch)])
        mine, local = index[first:last], triangle[first:last].astype(np.int64) - batch.first_triangle
        plain = table.materials.emission[batch.materials[local]] <= 0.0
        keep = plain & (atlas.texels[mine, 1] > MIN_OPACITY)
        mine, local = mine[keep], local[keep]
        if not len(mine):
            continue
        areas, normals = triangle_areas_and_normals(batch.corners_world)
        corners = charts.corner_texels(np.arange(batch.first_triangle, batch.first_triangle + len(batch)))
        own = BatchTexels(mine, local, corners, charts.page_side)
        numbers = local + batch.first_triangle
        if atlas.turned is not None:  # what is on the other side has other light
            normals = np.where(atlas.turned[batch.first_triangle :][: len(batch), None], -normals, normals)
        logs = charts.log_width[numbers].astype(np.float64) + charts.log_height[numbers]
        area = areas[local] / np.where(charts.kind[numbers] == SINGLE, 1.0, np.exp2(logs) / 2.0)
        values = atlas.texels[mine]
        colored = values.shape[1] == COLOR_CHANNELS
        albedo = base_colors(table, batch, own, area, spread=atlas.spread, colored=colored)
        albedo = np.maximum(albedo, np.float32(_LEAST_ALBEDO))
        shining = values[:, [0, 2, 3]] if albedo.shape[1] > 1 else values[:, :1]
        light = shining / (albedo * values[:, 1:2])
        variance = (noise[mine] / (albedo[:, 0] * values[:, 1])) ** 2
        weight = charts.page_samples[charts.page[numbers]] * values[:, 1]
        size = np.maximum(np.sqrt(area), charts.texel_world)
        # From the surface's corner, so that single precision tells texels apart far from the origin, too.
        points = _points(batch, local, texel_places(own)[:, 0]) - source.bounds_world[0]
        # Noise of what is black is not the noise of light.
        mixes = 2 * batch.materials[local].astype(np.int64) + (albedo[:, 0] <= _LEAST_ALBEDO)
        columns = (points, normals[local], size, mixes, light, variance, weight)
        kinds = (np.float32, np.float32, np.float32, np.int32, np.float32, np.float32, np.float32)
        yield Placed(
            mine,
            albedo,
            area.astype(np.float32),
            Texels(*(np.asarray(c, kind) for c, kind in zip(columns, kinds, strict=True))),
        )


def _points(batch: TriangleBatch, triangles: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Points (n, 3) float64 of triangles (n,)."""
    start = batch.corners_world[:, 0]
    edges = batch.corners_world[:, 1:] - start[:, None]
    found = np.empty((len(triangles), 3))

    def place(first: int, last: int) -> None:
        own, weights = triangles[first:last], barycentric[first:last]
        found[first:last] = start[own] + weights[:, :1] * edges[own, 0] + weights[:, 1:] * edges[own, 1]

    run_parts(place, len(triangles))
    return found


def cells_of(points: np.ndarray, size: np.ndarray, least: float, origin: np.ndarray) -> tuple[np.ndarray, Cells]:
    """Order (N,) of texels by cells, and these; texels of about one size share cells of REACH texels.

    points: (N, 3) world. size: (N,), at least `least`. origin: (3,) the lowest corner of all.
    """
    kind = np.floor(np.log2(size / least) + 0.5).astype(np.int64)
    side = REACH * least * np.exp2(kind + 0.5)
    cell = np.clip(np.floor((points - origin) / side[:, None]).astype(np.int64), 0, _AXIS_CELLS - 3) + 1
    keys = _key(kind, cell)
    order = np.argsort(keys, kind="stable")
    unique, start = np.unique(keys[order], return_index=True)
    own_kind, own = kind[order][start], cell[order][start]
    around = np.empty((len(unique), 27), np.int64)
    for number, (x, y, z) in enumerate(np.ndindex(3, 3, 3)):
        wanted = _key(own_kind, own + np.array([x, y, z]) - 1)
        place = np.minimum(np.searchsorted(unique, wanted), len(unique) - 1)
        around[:, number] = np.where(unique[place] == wanted, place, -1)
    return order, Cells(np.append(start, len(keys)).astype(np.int64), around)


def _key(kind: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """(N,) int64 of sizes (N,) and cells (N, 3)."""
    return np.asarray(((kind << _AXIS_BITS | cell[:, 0]) << _AXIS_BITS | cell[:, 1]) << _AXIS_BITS | cell[:, 2])
