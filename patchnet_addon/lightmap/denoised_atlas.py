# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoised atlas: texels as points on the surface, averaged and written back (methods 7.2g)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..runtime.kernels import kernel, lean_device
from ..runtime.threads import run_parts
from ..surface.mesh import MeshSource, TriangleBatch
from .atlas import Atlas
from .texel_bases import texel_bases, texel_centres

_LEAST_ALBEDO = 0.02  # least base colour; darker texels mix with each other only
_AXIS_BITS, _AXIS_CELLS = 19, 1 << 19

REACH = 5.0  # texels, of the second pass; the first one, which estimates differences, has REACH / 2
MOST_IN_CELL = 96  # most texels of a cell in an average: a sample of crowded triangles
MOST_WALLS = 512  # most texels of a cell tested as occluders
_CROSSING = 0.7  # largest absolute cosine of normals of an occluder
_AGREES = 0.8  # smallest cosine of normals of averaged texels
_LOW, _HIGH = 0.02, 1.6  # heights of occluders, in texels
_WIDE = 0.75  # half width of an occluder, in texels
_MOST_BETWEEN = 64
_SIGMAS = 1.5  # largest difference of averaged texels, in its standard deviations
_CELLS = 27
_PART = 1 << 16  # texels that are placed at once


class Texels(NamedTuple):
    """N texels of a surface to denoise together, in the order of their cells.

    points, normals: (N, 3) float32, world. size: (N,) float32, a texel's side. material: (N,) int32; only equal ones
    mix. light: (N, C) float32, incident light, luminance first. variance: (N,) float32, of the luminance. weight: (N,)
    float32, the number of paths.
    """

    points: np.ndarray
    normals: np.ndarray
    size: np.ndarray
    material: np.ndarray
    light: np.ndarray
    variance: np.ndarray
    weight: np.ndarray


class Cells(NamedTuple):
    """Cells of REACH texels: first texel of each (K + 1,) int64, and its neighbours (K, 27) int64, -1 for none."""

    first: np.ndarray
    around: np.ndarray


def denoise(texels: Texels, cells: Cells) -> np.ndarray:
    """Light (N, C) float32 without most of its noise."""
    count, channels = texels.light.shape
    boxes = np.concatenate([_boxes(values, cells.first) for values in (texels.points, texels.normals)], axis=1)
    bounds = boxes, np.ascontiguousarray(texels.points.T)
    guide = np.empty((count, 1 + channels), np.float32)
    none = np.empty((0, 1 + channels), np.float32)
    run_parts(_filter, len(cells.around), texels, cells, bounds, none, REACH / 2.0, guide)
    out = np.empty((count, 1 + channels), np.float32)
    run_parts(_filter, len(cells.around), texels, cells, bounds, guide, REACH, out)
    return out[:, 1:]


def _boxes(points: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Lowest and highest (K, 2, 3) float32 of values (N, 3) of the texels of each cell; first: (K + 1,)."""
    return np.stack([side.reduceat(points, first[:-1], axis=0) for side in (np.minimum, np.maximum)], axis=1)


@kernel
def _filter(first, last, texels, cells, bounds, guide, reach, out):  # type: ignore[no-untyped-def]
    """Write variance and light of the texels of some cells. bounds: boxes of cells (K, 4, 3), and points (3, N)."""
    picked = np.empty(MOST_WALLS, np.int64)  # most texels of a cell in either sum
    between = np.empty((_MOST_BETWEEN, 3))
    sums = np.empty(3 + texels.light.shape[1])  # weight, its square, variance, light
    for cell in range(first, last):
        for p in range(cells.first[cell], cells.first[cell + 1]):
            count = _find_between(texels, cells, bounds, cell, p, reach, picked, between)
            _add_around(texels, cells, bounds, (cell, p), (reach, guide), picked, (between, count), sums)
            if len(guide):
                out[p, 0] = sums[2] / (sums[0] * sums[0])
            else:
                out[p, 0] = sums[2] / sums[0] * sums[1] / (sums[0] * sums[0])
            for channel in range(texels.light.shape[1]):
                out[p, 1 + channel] = sums[3 + channel] / sums[0]


@lean_device
def _is_far(boxes, cell, x, y, z, farthest):  # type: ignore[no-untyped-def]
    """Return whether a whole cell is farther from a point than the root of `farthest`."""
    dx = max(float(boxes[cell, 0, 0]) - x, x - float(boxes[cell, 1, 0]), 0.0)
    dy = max(float(boxes[cell, 0, 1]) - y, y - float(boxes[cell, 1, 1]), 0.0)
    dz = max(float(boxes[cell, 0, 2]) - z, z - float(boxes[cell, 1, 2]), 0.0)
    return dx * dx + dy * dy + dz * dz > farthest


@lean_device
def _pick_near(points, texels, step, place, farthest, picked):  # type: ignore[no-untyped-def]
    """Write those of every `step`-th texel that are within the root of `farthest` of a place, or just beyond.

    points: (3, N). texels: the first, and the one after the last. Without branches on distances, which are
    unpredictable: most texels are far away.
    """
    x, y, z = np.float32(place[0]), np.float32(place[1]), np.float32(place[2])
    limit = np.float32(farthest * (1.0 + 1e-5))
    count = np.int64(0)
    for q in range(texels[0], texels[1], step):
        dx, dy, dz = points[0, q] - x, points[1, q] - y, points[2, q] - z
        picked[count] = q
        count += np.int64(dx * dx + dy * dy + dz * dz <= limit)
    return count


@lean_device
def _cosines(boxes, cell, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Bounds of the cosines of a normal with those of the texels of a cell, with a margin for rounding."""
    low, high = -1e-5, 1e-5
    for axis, along in ((0, nx), (1, ny), (2, nz)):
        one, two = along * boxes[cell, 2, axis], along * boxes[cell, 3, axis]
        low += min(one, two)
        high += max(one, two)
    return low, high


@lean_device
def _find_between(texels, cells, bounds, cell, p, reach, picked, between):  # type: ignore[no-untyped-def]
    """Write the places, in the plane of p, of texels of other surfaces on it; returns their number."""
    boxes, points = bounds
    size = float(texels.size[p])
    farthest = (reach * size) ** 2
    px, py, pz = float(texels.points[p, 0]), float(texels.points[p, 1]), float(texels.points[p, 2])
    nx, ny, nz = float(texels.normals[p, 0]), float(texels.normals[p, 1]), float(texels.normals[p, 2])
    count = 0
    for neighbour in range(_CELLS):
        near = cells.around[cell, neighbour]
        if near < 0 or _is_far(boxes, near, px, py, pz, farthest):
            continue
        low, high = _cosines(boxes, near, nx, ny, nz)
        if low >= _CROSSING or high <= -_CROSSING:  # parallel to the plane of p
            continue
        begin, end = cells.first[near], cells.first[near + 1]
        step = -(-(end - begin) // MOST_WALLS)
        for index in range(_pick_near(points, (begin, end), step, (px, py, pz), farthest, picked)):
            q = picked[index]
            x = float(texels.points[q, 0]) - px
            y = float(texels.points[q, 1]) - py
            z = float(texels.points[q, 2]) - pz
            if x * x + y * y + z * z > farthest:
                continue
            height = x * nx + y * ny + z * nz
            if height <= _LOW * size or height >= _HIGH * size:  # p itself is at 0
                continue
            cosine = texels.normals[q, 0] * nx + texels.normals[q, 1] * ny + texels.normals[q, 2] * nz
            if abs(cosine) >= _CROSSING:
                continue
            between[count, 0] = x - height * nx
            between[count, 1] = y - height * ny
            between[count, 2] = z - height * nz
            count += 1
            if count == _MOST_BETWEEN:
                return count
    return count


@lean_device
def _is_hidden(x, y, z, found, size):  # type: ignore[no-untyped-def]
    """Return whether an occluder is between the texel and a place (x, y, z) in its plane."""
    between, count = found
    length = math.sqrt(x * x + y * y + z * z)
    for index in range(count):
        bx, by, bz = between[index, 0], between[index, 1], between[index, 2]
        along = (x * bx + y * by + z * bz) / max(length, 1e-30)
        if along <= 0.0 or along >= length:
            continue
        across = bx * bx + by * by + bz * bz - along * along
        if across < (_WIDE * size) ** 2:
            return True
    return False


@lean_device
def _add_around(texels, cells, bounds, place, how, picked, found, sums):  # type: ignore[no-untyped-def]
    """Sum weights, variance and light of similar texels. place: cell and index of the texel. how: as of `_filter`."""
    boxes, points = bounds
    cell, p = place
    reach, guide = how
    size = float(texels.size[p])
    farthest = (reach * size) ** 2
    px, py, pz = float(texels.points[p, 0]), float(texels.points[p, 1]), float(texels.points[p, 2])
    nx, ny, nz = float(texels.normals[p, 0]), float(texels.normals[p, 1]), float(texels.normals[p, 2])
    sums[:] = 0.0
    _add(texels, p, float(texels.weight[p]), guide, sums)
    for neighbour in range(_CELLS):
        near = cells.around[cell, neighbour]
        if near < 0 or _is_far(boxes, near, px, py, pz, farthest):
            continue
        if _cosines(boxes, near, nx, ny, nz)[1] < _AGREES:
            continue
        begin, end = cells.first[near], cells.first[near + 1]
        step = -(-(end - begin) // MOST_IN_CELL)
        for index in range(_pick_near(points, (begin, end), step, (px, py, pz), farthest, picked)):
            q = picked[index]
            x = float(texels.points[q, 0]) - px
            y = float(texels.points[q, 1]) - py
            z = float(texels.points[q, 2]) - pz
            squared = x * x + y * y + z * z
            if squared > farthest or q == p or texels.material[q] != texels.material[p]:
                continue
            cosine = texels.normals[q, 0] * nx + texels.normals[q, 1] * ny + texels.normals[q, 2] * nz
            height = x * nx + y * ny + z * nz
            if cosine < _AGREES or abs(height) > 0.3 * size + 0.15 * math.sqrt(squared):
                continue
            if _is_hidden(x - height * nx, y - height * ny, z - height * nz, found, size):
                continue
            weight = math.exp(-2.0 * squared / farthest) * float(texels.weight[q]) * cosine**8
            if len(guide):
                difference = float(guide[q, 1]) - float(guide[p, 1])
                noise = float(guide[q, 0]) + float(guide[p, 0])
                weight *= math.exp(-difference * difference / max(2.0 * _SIGMAS * _SIGMAS * noise, 1e-30))
            _add(texels, q, weight, guide, sums)


@lean_device
def _add(texels, q, weight, guide, sums):  # type: ignore[no-untyped-def]
    sums[0] += weight
    sums[1] += weight * weight
    sums[2] += (weight * weight if len(guide) else weight) * float(texels.variance[q])
    for channel in range(texels.light.shape[1]):
        sums[3 + channel] += weight * float(texels.light[q, channel])


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
    placed = placed_texels(atlas, source, facing)
    if placed is None:
        return replace(atlas, noise=None)
    index, base, texels = placed
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


def placed_texels(
    atlas: Atlas, source: MeshSource, facing: float = 1.0
) -> tuple[np.ndarray, np.ndarray, Texels] | None:
    """Texels to denoise of an atlas with `noise`: all with surface that do not emit, in any order; None for none.

    Also, before them, their places in the atlas (n,) and base colours (n, C). facing: 1, or -1 for an atlas of backs.
    """
    parts = list(_placed(atlas, source, facing))
    if not parts:
        return None
    place, base, *texels = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return place, base, Texels(*texels)


def _placed(atlas: Atlas, source: MeshSource, facing: float) -> Iterator[tuple[np.ndarray, ...]]:
    """Places, base colours and columns of `Texels` of an atlas with `noise`, part by part.

    Points are relative to the surface's lower corner: single precision separates texels far from the world's origin.
    """
    charts, origin = atlas.charts, source.bounds_world[0]
    assert atlas.noise is not None
    for part in texel_bases(atlas, source):
        batch, centres = part.batch, texel_centres(part.own)
        columns = [0, 2, 3] if part.color.shape[1] > 1 else [0]
        for first in range(0, len(centres), _PART):
            here = slice(first, first + _PART)
            mine, local, base = part.own.texels[here], part.own.triangles[here], part.color[here]
            values, albedo = atlas.texels[mine], divisor(base)
            opacity = values[:, 1]
            yield (
                mine,
                base,
                (_points(batch, local, centres[here]) - origin).astype(np.float32),
                (facing * triangle_areas_and_normals(batch.corners_world[local])[1]).astype(np.float32),
                np.maximum(np.sqrt(part.area[here]), charts.texel_world).astype(np.float32),
                # Noise of black texels is not noise of light.
                (2 * batch.materials[local] + (albedo[:, 0] <= _LEAST_ALBEDO)).astype(np.int32),
                values[:, columns] / (albedo * opacity[:, None]),
                (atlas.noise[mine] / (albedo[:, 0] * opacity)) ** 2,
                (charts.page_samples[charts.page[local + batch.first_triangle]] * opacity).astype(np.float32),
            )


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
