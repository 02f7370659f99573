# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of light cells, from the baked light of their surfels, filtered over neighbouring cells (methods 7.2h)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..cells.morton_kernels import cell_key
from ..octree.grid import Grid
from ..octree.voxelize import triangle_areas_and_normals
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..surface.mesh import Fragments, MeshSource
from ..surface.texture_lookup import color_of_fragments, surface_of_fragments
from ..surface.textures import TextureTable
from .hashing import fill_slots, mixed, row_of_key, slots_for
from .seen_cells import LEVEL_BITS
from .surfels import BACK

MIN_OPACITY = 1e-3  # of a surfel: below it, its paths met gaps alone
LEAST_BASE = np.float32(0.02)  # of a base colour that light is divided by, and multiplied with again
ANY_SHEET, ANY_FACE = -2, 6  # of cells that hold the mean over all sheets, or all faces
STEPS = 1, 2, 4, 8  # distances of averaged cells, pass by pass
_SIGMAS = 2.0  # largest difference of averaged cells, in its standard deviations
_LEAST_NOISE = 0.01  # of the light
_NOTHING = 1e-30
_DISTANCE = 0.25  # decay of weights with the squared distance
_LEAST_WEIGHT = 1e-3  # of a neighbour
_NOISE_STEPS = 2  # passes over which noise is averaged first
_AROUND = 8  # most neighbours at a distance


class SurfelSurface(NamedTuple):
    """Surface of N surfels: places (N, 3) and unit normals (N, 3) of the lit side, float64, in the world.

    base: (N, 1) float32, luminance of the base colour, or (N, 4) with red, green and blue; 1 where light is not in
    proportion to it: for emitters, and where it is not known. is_filtered: (N,) bool, where it is. material: (N,).
    """

    place: np.ndarray
    normal: np.ndarray
    base: np.ndarray
    is_filtered: np.ndarray
    material: np.ndarray


class LightCells(NamedTuple):
    """Light cells in R rows with their keys (R,) uint64, and the slots of these.

    light: (R, C) float32, radiance over base colour: luminance, and with colour red, green and blue. noise: (R,)
    float32, standard deviation of the radiance, in luminance. radiance: (R,) float32. pixels: (R,) float32, that show
    the cell, 0 for what no camera sees. The first rows are those of the N surfels, in their order, further ones means
    over sheets and faces. Cells whose paths met gaps alone are not in the slots, and no pixels show them.
    """

    keys: np.ndarray
    slots: np.ndarray
    light: np.ndarray
    noise: np.ndarray
    radiance: np.ndarray
    pixels: np.ndarray


class _Neighbours(NamedTuple):
    """Neighbours of C cells at one distance: those of cell i are rows[first[i] : first[i + 1]], with weights."""

    first: np.ndarray
    rows: np.ndarray
    weights: np.ndarray


class _Places(NamedTuple):
    """Cells of N surfels: `cell` as in `SeenCells`, face, sheet; place in the octree's cube and normal (N, 3); whether
    they are filtered.
    """

    cell: np.ndarray
    face: np.ndarray
    sheet: np.ndarray
    unit: np.ndarray
    normal: np.ndarray
    is_filtered: np.ndarray


class _Group(NamedTuple):
    """Rows of means over several cells: their keys (G,), the cells in the order of groups, and the first of each."""

    keys: np.ndarray
    order: np.ndarray
    start: np.ndarray


def reflecting(table: TextureTable, known: Sequence[bool]) -> np.ndarray:
    """(M,) bool: materials whose light is in proportion to a base colour that is `known`."""
    return np.asarray(known, bool) & (table.materials.emission <= 0.0)


def surface_of_surfels(
    surfels: np.ndarray, source: MeshSource, table: TextureTable, reflects: np.ndarray, *, color: bool
) -> SurfelSurface:
    """Surface at surfels (N,) SURFEL. reflects: see `reflecting`."""
    count = len(surfels)
    place, normal = np.zeros((count, 3)), np.zeros((count, 3))
    base, material = np.ones((count, 4 if color else 1), np.float32), np.zeros(count, np.int32)
    order = np.argsort(surfels["triangle"], kind="stable")
    triangles = surfels["triangle"][order]
    for batch in source.batches():
        first, last = np.searchsorted(triangles, [batch.first_triangle, batch.first_triangle + len(batch)])
        mine = order[first:last]
        if not len(mine):
            continue
        local = (triangles[first:last] - batch.first_triangle).astype(np.int32)
        own = surfels[mine]
        weights = np.stack([own["one"], own["two"]], axis=1)
        fragments = Fragments(own["leaf"], local, weights, own["area"].astype(np.float64))
        corners = batch.corners_world[local]
        edges = corners[:, 1:] - corners[:, :1]
        place[mine] = corners[:, 0] + weights[:, :1] * edges[:, 0] + weights[:, 1:] * edges[:, 1]
        sign = np.where(own["side"] == BACK, -1.0, 1.0)
        normal[mine] = sign[:, None] * triangle_areas_and_normals(corners)[1]
        luminance, _ = surface_of_fragments(table, batch, fragments)
        base[mine, 0], material[mine] = luminance, batch.materials[local]
        if color:
            base[mine, 1:] = color_of_fragments(table, batch, fragments, luminance)
    base = np.maximum(base, LEAST_BASE)
    is_filtered = reflects[material]
    base[~is_filtered] = 1.0
    return SurfelSurface(place, normal, base, is_filtered, material)


class SurfelSums(NamedTuple):
    """Sums over the paths of N surfels.

    light: (N, C) float64, luminance, with colour red, green and blue, all times opacity, opacity, and squared luminance
    times opacity. samples: (N,), their number. measured: (N,), of parts that they are measured in.
    """

    light: np.ndarray
    samples: np.ndarray
    measured: np.ndarray

    @staticmethod
    def zeros(count: int, channels: int) -> SurfelSums:
        """Sums over no paths."""
        return SurfelSums(np.zeros((count, channels)), np.zeros(count, np.int64), np.zeros(count, np.int64))

    def add(self, surfels: np.ndarray, means: np.ndarray, samples: int, parts: int = 2) -> None:
        """Add means (n, C) over `samples` paths of surfels (n,), in so many parts."""
        self.light[surfels] += means.astype(np.float64) * samples
        self.samples[surfels] += samples
        self.measured[surfels] += parts


class CellGrid:
    """Light cells of surfels (N,) SURFEL without light: their keys, those that they are averaged with, and groups."""

    def __init__(self, surfels: np.ndarray, surface: SurfelSurface, grid: Grid, *, filtered: bool) -> None:
        """Find the neighbours on the octree's grid. filtered: light is averaged over them, within noise.

        Their noise is averaged in any case: cells whose few paths all met darkness show none.
        """
        self._surface, self._share, self._pixels = surface, surfels["share"], surfels["pixels"]
        cell, face, sheet = surfels["cell"], surfels["face"].astype(np.int64), surfels["sheet"].astype(np.int64)
        self._keys = _keys(cell, face, sheet)
        self._groups = [_group(cell, face), _group(cell, np.full(len(cell), ANY_FACE, np.int64))]
        self._neighbours: list[_Neighbours] = []
        self._is_filtered = filtered
        if len(cell):
            unit = grid.to_unit(surface.place)
            places = _Places(cell, face, sheet, unit, surface.normal, surface.is_filtered)
            slots = slots_for(len(cell))
            fill_slots(slots, self._keys, np.arange(len(cell)))
            self._neighbours = [
                _neighbours(self._keys, slots, places, step) for step in (STEPS if filtered else STEPS[:1])
            ]

    def light(self, sums: SurfelSums) -> LightCells:
        """Light of the cells by that of their surfels."""
        baked, base = sums.light / sums.samples[:, None], self._surface.base
        there = baked[:, -2] > MIN_OPACITY
        opacity = np.where(there, baked[:, -2], np.inf)
        mean = (baked[:, :-2] / opacity[:, None] / base).astype(np.float32)
        # The variance of a mean of parts is that between them over their number less one.
        squared = baked[:, -1] / opacity / base[:, 0].astype(np.float64) ** 2
        spread = np.maximum(squared - mean[:, 0].astype(np.float64) ** 2, 0.0) / np.maximum(sums.measured - 1, 1)
        noise = np.sqrt(np.where(sums.measured > 1, spread, squared)).astype(np.float32)
        for near in self._neighbours[:_NOISE_STEPS]:
            around = np.empty_like(noise)
            run_parts(_spread, len(noise), near, there, noise, around)
            noise = around
        guide, apart = mean[:, 0], noise
        for number, near in enumerate(self._neighbours):
            if number == 0:  # light and noise of a few paths are too rough to tell which neighbours are alike
                guide, apart = np.empty_like(noise), np.empty_like(noise)
                run_parts(_blur, len(noise), near, there, mean, noise, guide, apart)
            if not self._is_filtered:  # a cell whose few paths all met darkness is as noisy as those around
                noise = np.maximum(noise, apart)
                continue
            smooth, left = np.empty_like(mean), np.empty_like(noise)
            weights, totals = np.empty(len(near.rows), np.float32), np.empty_like(noise)
            run_parts(_weigh, len(mean), near, there, guide, apart, weights, totals)
            run_parts(_filter, len(mean), near, weights, totals, (mean, noise), smooth, left)
            mean, noise = smooth, left
            guide, apart = np.ascontiguousarray(mean[:, 0]), noise
        share, pixels = np.where(there, self._share, 0.0), np.where(there, self._pixels, np.float32(0.0))
        return self._with_means([mean, noise * base[:, 0], mean[:, 0] * base[:, 0], pixels], share)

    def _with_means(self, own: list[np.ndarray], share: np.ndarray) -> LightCells:
        """Rows of cells, and of the means over their sheets, and over their faces."""
        columns = [own]
        keys = [self._keys]
        there = [share > 0.0]
        for group in self._groups:
            if not len(group.start):
                continue
            weight = share[group.order]
            total = np.add.reduceat(weight, group.start)
            safe = np.where(total > 0.0, total, 1.0)
            light, noise, radiance, pixels = (column[group.order] for column in own)
            means = [np.add.reduceat(weight * column, group.start) / safe for column in (noise, radiance)]
            lights = np.add.reduceat(weight[:, None] * light, group.start, axis=0) / safe[:, None]
            columns.append([lights, *means, np.maximum.reduceat(pixels, group.start)])
            keys.append(group.keys)
            there.append(total > 0.0)
        light, noise, radiance, pixels = (
            np.concatenate(column).astype(np.float32) for column in zip(*columns, strict=True)
        )
        all_keys = np.concatenate(keys)
        slots = slots_for(len(all_keys))
        fill_slots(slots, all_keys, np.flatnonzero(np.concatenate(there)))
        return LightCells(all_keys, slots, light, noise, radiance, pixels)


@kernel
def _hash_keys(cell, face, sheet, out):  # type: ignore[no-untyped-def]
    for i in range(len(cell)):
        out[i] = mixed(mixed(cell[i], face[i]), sheet[i])


def _keys(cell: np.ndarray, face: np.ndarray, sheet: np.ndarray) -> np.ndarray:
    """Keys (n,) uint64 of cells with faces and sheets (n,) int64."""
    out = np.empty(len(cell), np.uint64)
    _hash_keys(cell, face, sheet, out)
    return out


def _group(cell: np.ndarray, face: np.ndarray) -> _Group:
    """Groups of equal cells (C,) uint64 and faces (C,) int64."""
    order = np.lexsort((face, cell))
    changed = np.ones(len(order), bool)
    changed[1:] = (cell[order][1:] != cell[order][:-1]) | (face[order][1:] != face[order][:-1])
    start = np.flatnonzero(changed)
    found = order[start]
    return _Group(_keys(cell[found], face[found], np.full(len(found), ANY_SHEET, np.int64)), order, start)


# Passes over ever farther neighbours (Dammertz et al., Edge-Avoiding A-Trous Wavelet Transform for fast Global
# Illumination Filtering, 2010), guided by noise (Schied et al., Spatiotemporal Variance-Guided Filtering, 2017).


def _neighbours(keys: np.ndarray, slots: np.ndarray, places: _Places, step: int) -> _Neighbours:
    """Neighbours of cells at a distance of `step` cells in their planes: of the same face, sheet and level."""
    count = len(keys)
    found, alike = np.empty((count, _AROUND), np.int32), np.empty((count, _AROUND), np.float32)
    counts = np.empty(count, np.int64)
    run_parts(_find_neighbours, count, keys, slots, places, step, (found, alike, counts))
    first = np.concatenate([[0], np.cumsum(counts)])
    mine = np.arange(_AROUND) < counts[:, None]
    return _Neighbours(first, found[mine], alike[mine])


@kernel
def _find_neighbours(first, last, keys, slots, places, step, out):  # type: ignore[no-untyped-def]
    found, alike, counts = out
    for i in range(first, last):
        counts[i] = 0
        if not places.is_filtered[i]:
            continue
        one, two = _tangents(places.normal[i, 0], places.normal[i, 1], places.normal[i, 2])
        for n in range(9):
            across, up = n % 3 - 1, n // 3 - 1
            if across == 0 and up == 0:  # its place may be in another cell, by rounding
                continue
            row = _neighbour(keys, slots, places, i, (step * across, step * up), one, two)
            if row < 0 or row == i:
                continue
            weight = _alike(places, i, row) * math.exp(-_DISTANCE * (across * across + up * up))
            if weight > _LEAST_WEIGHT:
                found[i, counts[i]], alike[i, counts[i]] = row, weight
                counts[i] += 1


@device
def _tangents(x, y, z):  # type: ignore[no-untyped-def]
    """Two unit vectors across a unit normal and each other, along the axes of the octree if the normal is."""
    if abs(x) >= abs(y) and abs(x) >= abs(z):
        length = math.sqrt(x * x + y * y)
        one = (-y / length, x / length, 0.0)
    elif abs(y) >= abs(z):
        length = math.sqrt(y * y + z * z)
        one = (0.0, -z / length, y / length)
    else:
        length = math.sqrt(z * z + x * x)
        one = (z / length, 0.0, -x / length)
    return one, (y * one[2] - z * one[1], z * one[0] - x * one[2], x * one[1] - y * one[0])


@device
def _neighbour(keys, slots, places, i, away, one, two):  # type: ignore[no-untyped-def]
    """Row of the cell around a point `away` in the plane of a cell, or next to that one along the face's axis; -1 for
    none.
    """
    level = np.int64(places.cell[i] & np.uint64((1 << LEVEL_BITS) - 1))
    side = np.int64(1) << level
    x = math.floor(places.unit[i, 0] * side + away[0] * one[0] + away[1] * two[0])
    y = math.floor(places.unit[i, 1] * side + away[0] * one[1] + away[1] * two[1])
    z = math.floor(places.unit[i, 2] * side + away[0] * one[2] + away[1] * two[2])
    axis = places.face[i] // 2
    for off in range(3):
        by = (off + 1) % 3 - 1  # 0, 1, -1
        a, b, c = x + by * (axis == 0), y + by * (axis == 1), z + by * (axis == 2)
        if a < 0 or b < 0 or c < 0 or a >= side or b >= side or c >= side:
            continue
        other = (cell_key(a, b, c) << np.uint64(LEVEL_BITS)) | np.uint64(level)
        row = row_of_key(slots, keys, mixed(mixed(other, places.face[i]), places.sheet[i]))
        if row >= 0 and places.is_filtered[row]:
            return row
    return np.int64(-1)


@device
def _alike(places, i, j):  # type: ignore[no-untyped-def]
    """Weight of how well two cells' surfaces lie in one plane."""
    cosine = 0.0
    height = 0.0
    length = 0.0
    for axis in range(3):
        cosine += places.normal[i, axis] * places.normal[j, axis]
        apart = places.unit[j, axis] - places.unit[i, axis]
        height += apart * places.normal[i, axis]
        length += apart * apart
    if cosine <= 0.0:
        return 0.0
    return cosine**8 * math.exp(-9.0 * height * height / max(length, 1e-300))


@kernel
def _spread(first, last, near, there, noise, out):  # type: ignore[no-untyped-def]
    """Write the root of the mean variance of cells and their neighbours: that of a few paths is rough itself."""
    for i in range(first, last):
        total, count = float(noise[i]) ** 2, 1
        for n in range(near.first[i], near.first[i + 1]):
            if there[near.rows[n]] and there[i]:
                total += float(noise[near.rows[n]]) ** 2
                count += 1
        out[i] = math.sqrt(total / count)


@kernel
def _blur(first, last, near, there, light, noise, guide, left):  # type: ignore[no-untyped-def]
    """Write means of luminance over cells and their neighbours, and the noise of these."""
    for i in range(first, last):
        total, variance, weights = float(light[i, 0]), float(noise[i]) ** 2, 1.0
        for n in range(near.first[i], near.first[i + 1]):
            row, weight = near.rows[n], float(near.weights[n])
            if there[row] and there[i]:
                total += weight * light[row, 0]
                variance += weight * weight * float(noise[row]) ** 2
                weights += weight
        guide[i] = total / weights
        left[i] = math.sqrt(variance) / weights


@kernel
def _weigh(first, last, near, there, guide, apart, weights, totals):  # type: ignore[no-untyped-def]
    """Write the weight of each neighbour, by how well the guides (N,) agree within their noise, and each cell's sum."""
    for i in range(first, last):
        total = 1.0
        for n in range(near.first[i], near.first[i + 1]):
            row = near.rows[n]
            weights[n] = 0.0
            if not there[row] or not there[i]:
                continue
            sigma = _SIGMAS * math.sqrt(float(apart[i]) ** 2 + float(apart[row]) ** 2)
            sigma += _LEAST_NOISE * max(abs(float(guide[i])), abs(float(guide[row]))) + _NOTHING
            differs = (float(guide[row]) - float(guide[i])) / sigma
            weights[n] = near.weights[n] * math.exp(-differs * differs)
            total += weights[n]
        totals[i] = total


@kernel
def _filter(first, last, near, weights, totals, values, smooth, left):  # type: ignore[no-untyped-def]
    """Write means over neighbours of light (N, C), and the noise that is left; values: light, and its noise (N,).

    Two cells exchange equal shares, so that their sum stays: else cells that few others agree with, the bright ones of
    a few paths, would count less.
    """
    light, noise = values
    channels = light.shape[1]
    sums = np.empty(channels)
    for i in range(first, last):
        own, variance = 1.0, 0.0
        sums[:] = 0.0
        for n in range(near.first[i], near.first[i + 1]):
            row = near.rows[n]
            share = float(weights[n]) / max(float(totals[i]), float(totals[row]))
            own -= share
            variance += share * share * float(noise[row]) ** 2
            for c in range(channels):
                sums[c] += share * light[row, c]
        left[i] = math.sqrt(variance + own * own * float(noise[i]) ** 2)
        for c in range(channels):
            smooth[i, c] = sums[c] + own * light[i, c]
