# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of light cells, from the baked light of their surfels, filtered over neighbouring cells (methods 7.2h)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..cells.hashing import fill_slots, mixed, slots_for
from ..octree.grid import Grid
from ..runtime.kernels import kernel
from ..surface.mesh import Fragments, MeshSource
from ..surface.sides import SIGNS
from ..surface.texture_lookup import BaseColors, base_of_fragments
from ..surface.textures import TextureTable
from ..surface.triangles import triangle_areas_and_normals
from .cell_filter import NOISE_STEPS, STEPS, Neighbours, Places, filtered, neighbours
from .seen_cells import LEVEL_BITS

MIN_OPACITY = 1e-3  # of a surfel: below it, its paths met gaps alone
ANY_SHEET, ANY_FACE = -3, 6  # of cells that hold the mean over all sheets, or all faces


class SurfelSurface(NamedTuple):
    """Surface of N surfels: places (N, 3) and unit normals (N, 3) of the lit side, float64, in the world.

    base: (N, 1) float32, luminance of the base colour, or (N, 4) with red, green and blue; 1 where light is not in
    proportion to it: for emitters, and where it is not known. is_filtered: (N,) bool, where light varies slowly once it
    is divided by that. material: (N,).
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
        normal[mine] = np.take(SIGNS, own["side"])[:, None] * triangle_areas_and_normals(corners)[1]
        base[mine] = base_of_fragments(BaseColors(table, reflects), batch, fragments, color=color)
        material[mine] = batch.materials[local]
    return SurfelSurface(place, normal, base, reflects[material], material)


class SurfelSums(NamedTuple):
    """Sums over the paths of N surfels.

    light: (N, C) float64, luminance, with colour red, green and blue, all times opacity, opacity, and half the
    difference of luminance times opacity in two parts of them. samples: (N,), their number. half: (N,) float64, as
    noisy as the mean: half the difference of the parts in the first round; then its change from round to round, since
    light that varies over a surfel makes its parts differ whatever the number of paths.
    """

    light: np.ndarray
    samples: np.ndarray
    half: np.ndarray

    @staticmethod
    def zeros(count: int, channels: int) -> SurfelSums:
        """Sums over no paths."""
        return SurfelSums(np.zeros((count, channels)), np.zeros(count, np.int64), np.zeros(count))

    def add(self, surfels: np.ndarray, means: np.ndarray, samples: int) -> None:
        """Add means (n, C) over `samples` paths of surfels (n,)."""
        before, own = self.samples[surfels], means[:, -1].astype(np.float64)
        change = own - self.light[surfels, -1] / np.maximum(before, 1)
        self.half[surfels] = np.where(before > 0, np.sqrt(samples * before) / (samples + before) * change, own)
        self.light[surfels] += means.astype(np.float64) * samples
        self.samples[surfels] += samples


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
        self._neighbours: list[Neighbours] = []
        self._is_filtered = filtered
        if len(cell):
            unit = grid.to_unit(surface.place)
            level, seen = cell & np.uint64((1 << LEVEL_BITS) - 1), surfels["pixels"] > 0.0
            area = 0.25 ** level.astype(np.float64)
            places = Places(cell, face, sheet, unit, surface.normal, area, seen, surface.is_filtered)
            slots = slots_for(len(cell))
            fill_slots(slots, self._keys, np.arange(len(cell)))
            self._neighbours = [
                neighbours(self._keys, slots, places, step) for step in (STEPS if filtered else STEPS[:NOISE_STEPS])
            ]

    def light(self, sums: SurfelSums) -> LightCells:
        """Light of the cells by that of their surfels."""
        baked, base = sums.light / sums.samples[:, None], self._surface.base
        there = baked[:, -2] > MIN_OPACITY
        opacity = np.where(there, baked[:, -2], np.inf)
        mean = (baked[:, :-2] / opacity[:, None] / base).astype(np.float32)
        half = (sums.half / opacity / base[:, 0]).astype(np.float32)
        mean, noise = filtered(self._neighbours, there, mean, half, base, smooths=self._is_filtered)
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
def _hash_keys(cell, face, sheet, out):
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
