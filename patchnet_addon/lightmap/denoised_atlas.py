# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoised atlas: texels as points on the surface, averaged and written back (methods 7.2g)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..runtime.threads import run_parts
from ..surface.mesh import MeshSource, TriangleBatch
from .atlas import Atlas
from .denoise import REACH, Cells, Texels, denoise
from .texel_bases import TexelBases, texel_bases
from .texel_places import texel_places

_LEAST_ALBEDO = 0.02  # least base colour; darker texels mix with each other only
_AXIS_BITS, _AXIS_CELLS = 19, 1 << 19


class Placed(NamedTuple):
    """Texels to denoise, and their places in the atlas.

    base: (n, C) float32, base colours, see `divisor`. area: (n,) float32, surface of each texel.
    """

    place: np.ndarray
    base: np.ndarray
    area: np.ndarray
    texels: Texels

    def between(self, first: int, last: int) -> Placed:
        """View of a range of texels."""
        texels = Texels(*(column[first:last] for column in self.texels))
        return Placed(self.place[first:last], self.base[first:last], self.area[first:last], texels)


def denoised_atlas(atlas: Atlas, source: MeshSource) -> Atlas:
    """Atlas whose texels are averaged with nearby texels of the same light; an atlas without `noise` is unchanged.

    Emitters keep their own light, which has no noise. Backs are averaged with backs.
    """
    if atlas.noise is None:
        return atlas
    back = None if atlas.back is None else _denoised(atlas.back, source, -1.0)
    return replace(_denoised(atlas, source, 1.0), back=back)


def _denoised(atlas: Atlas, source: MeshSource, facing: float) -> Atlas:
    """Denoise one side; facing: 1 for fronts, -1 for backs."""
    index, base, _, texels = placed_texels(atlas, source, facing)
    if not len(index):
        return replace(atlas, noise=None)
    bases = np.zeros((len(atlas.texels), base.shape[1]), np.float32)
    bases[index] = base
    order, cells = cells_of(texels.points, texels.size, atlas.charts.texel_world, np.zeros(3))
    found = denoise(Texels(*(np.ascontiguousarray(column[order]) for column in texels)), cells)
    index = index[order]
    values = atlas.texels.copy()
    columns = [0, 2, 3] if base.shape[1] > 1 else [0]
    values[index[:, None], columns] = found * divisor(base[order]) * values[index, 1:2]
    return replace(atlas, texels=values, noise=None, base=bases)


def divisor(base: np.ndarray) -> np.ndarray:
    """Base colours (n, C) by which light is divided before averaging and multiplied after it."""
    return np.maximum(base, np.float32(_LEAST_ALBEDO))


def placed_texels(atlas: Atlas, source: MeshSource, facing: float = 1.0) -> Placed:
    """Texels to denoise of an atlas with `noise`: all with surface that do not emit, in any order.

    facing: 1, or -1 for an atlas of backs.
    """
    parts = list(texel_bases(atlas, source))
    ends = np.cumsum([len(part.own) for part in parts]).tolist()
    found = _blank(ends[-1] if ends else 0, parts[0].color.shape[1] if parts else 1)
    for part, last in zip(parts, ends, strict=True):
        _place(atlas, part, (source.bounds_world[0], facing), found.between(last - len(part.own), last))
    return found


def _blank(count: int, channels: int) -> Placed:
    def column(*shape: int, kind: type = np.float32) -> np.ndarray:
        return np.empty((count, *shape), kind)

    texels = Texels(
        column(3), column(3), column(), column(kind=np.int32), column(channels), column(), column()
    )  # fmt: skip
    return Placed(column(kind=np.int64), column(channels), column(), texels)


def _place(atlas: Atlas, part: TexelBases, frame: tuple[np.ndarray, float], out: Placed) -> None:
    """Write the texels of one batch of an atlas with `noise`; frame: the surface's lower corner (3,), sign of normals.

    Relative to that corner, single precision separates texels far from the world's origin, too.
    """
    batch, own, charts, noise = part.batch, part.own, atlas.charts, atlas.noise
    origin, facing = frame
    assert noise is not None
    normals = facing * triangle_areas_and_normals(batch.corners_world)[1]
    centres = texel_places(own)[:, 0]
    columns = [0, 2, 3] if part.color.shape[1] > 1 else [0]

    def place(first: int, last: int) -> None:
        mine, local, here = own.texels[first:last], own.triangles[first:last], out.between(first, last)
        values, base, area, texels = atlas.texels[mine], part.color[first:last], part.area[first:last], here.texels
        albedo, opacity = divisor(base), values[:, 1]
        here.place[:], here.base[:], here.area[:] = mine, base, area
        texels.points[:] = _points(batch, local, centres[first:last]) - origin
        texels.normals[:] = normals[local]
        texels.size[:] = np.maximum(np.sqrt(area), charts.texel_world)
        # Noise of black texels is not noise of light.
        texels.material[:] = 2 * batch.materials[local].astype(np.int64) + (albedo[:, 0] <= _LEAST_ALBEDO)
        texels.light[:] = values[:, columns] / (albedo * opacity[:, None])
        texels.variance[:] = (noise[mine] / (albedo[:, 0] * opacity)) ** 2
        texels.weight[:] = charts.page_samples[charts.page[local + batch.first_triangle]] * opacity

    run_parts(place, len(own))


def _points(batch: TriangleBatch, triangles: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Points (n, 3) float64 of triangles (n,)."""
    corners = batch.corners_world[triangles]
    edges = corners[:, 1:] - corners[:, :1]
    return np.asarray(corners[:, 0] + barycentric[:, :1] * edges[:, 0] + barycentric[:, 1:] * edges[:, 1])


def cells_of(points: np.ndarray, size: np.ndarray, least: float, origin: np.ndarray) -> tuple[np.ndarray, Cells]:
    """Order (N,) of texels by cells, and the cells; texels of similar size share cells of REACH texels.

    points: (N, 3) world. size: (N,), at least `least`. origin: (3,) lowest corner of all points.
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
