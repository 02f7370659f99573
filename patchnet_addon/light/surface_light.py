# SPDX-License-Identifier: GPL-3.0-or-later
"""Look-up of baked light by the fragments of a surface (methods 7.2h)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..cells.hashing import mixed, row_of_key
from ..cells.morton import morton_encode
from ..octree.grid import Grid
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..surface.mesh import Fragments, Shading, ShadingFn, TriangleBatch
from ..surface.side_kernels import is_lit
from ..surface.sides import BACK, FRONT, LIT_BACK, LIT_FRONT, mean_of_sides
from ..surface.texture_lookup import BaseColors, base_of_fragments, surface_of_fragments
from ..surface.textures import TextureTable
from .light_cells import ANY_FACE, ANY_SHEET, LightCells
from .seen_cells import ABOVE_LEAVES, LEVEL_BITS
from .sheets import Sheets
from .surfels import COARSE, side_of_sheet

_DARK = 0.02  # of the other side's light: enclosed
NOWHERE, COARSELY, FINELY = 0, 1, 2  # where the light of a side was found


class MaterialSides(NamedTuple):
    """Materials (M,) bool: `reflects`, see `reflecting`; `through`, cut-out and translucent ones, whose one luminance
    is the mean of both sides.
    """

    reflects: np.ndarray
    through: np.ndarray


class _Places(NamedTuple):
    """Fragments (F,) of a level: keys, triangle as in `Fragments`; above: least levels of light cells above leaves."""

    keys: np.ndarray
    triangle: np.ndarray
    level: int
    above: int


class BakedColors(NamedTuple):
    """Base colours that were baked as light is: of leaves, as `cells`; materials: (M,) bool, those that have them."""

    cells: LightCells
    materials: np.ndarray


def cells_shade(
    cells: LightCells,
    table: TextureTable,
    sheets: Sheets,
    materials: MaterialSides,
    *,
    color: bool,
    colors: BakedColors | None = None,
) -> ShadingFn:
    """ShadingFn of light cells: that of the finest one above a fragment with its sheet and face, times its base colour.

    Without such a cell, the mean over the cell's sheets. Lights are of both sides. The one luminance is that of the
    side that cameras see; of both, or without cameras, that of the front, or of the back where the front is enclosed
    and dark. Of `through` materials it is the mean, without an enclosed, dark side.
    """

    base = BaseColors(table, materials.reflects)

    def shade(batch: TriangleBatch, fragments: Fragments) -> Shading:
        _, opacity = surface_of_fragments(table, batch, fragments)
        own = sheets.of(batch)
        lights = np.zeros((len(fragments), 2, cells.light.shape[1]), np.float32)
        where = np.zeros((len(fragments), 2), np.uint8)
        places = _Places(fragments.keys, fragments.triangle, fragments.level, ABOVE_LEAVES)
        run_parts(_look_up, len(fragments), places, own, cells, lights, where)
        material = batch.materials[fragments.triangle]
        lights *= base_of_fragments(base, batch, fragments, color=color)[:, None]
        if colors is not None:
            found = np.ones_like(lights)
            leaves = places._replace(above=0)
            run_parts(_look_up, len(fragments), leaves, own, colors.cells, found, np.empty_like(where))
            lights *= np.where(colors.materials[material][:, None, None], found, np.float32(1.0))
        lit = own.lit[fragments.triangle]
        mean = mean_of_sides(lights, _back_share(lights[..., 0], where, lit, materials.through[material]))
        shading = Shading(mean[:, 0], opacity, sides=lights, lit=own.lit)
        return shading._replace(color=mean[:, 1:]) if color else shading

    return shade


def upright_shade(shade: ShadingFn, rotation: np.ndarray, grid: Grid) -> ShadingFn:
    """ShadingFn for fragments of a rotated surface by that of the upright one, which looks up cells of `grid`.

    rotation: (3, 3), of `RotatedSource`.
    """

    def upright(batch: TriangleBatch, fragments: Fragments) -> Shading:
        corners = batch.corners_world @ rotation
        own = corners[fragments.triangle]
        one, two = fragments.barycentric[:, :1].astype(np.float64), fragments.barycentric[:, 1:].astype(np.float64)
        places = own[:, 0] + one * (own[:, 1] - own[:, 0]) + two * (own[:, 2] - own[:, 0])
        last = (1 << fragments.level) - 1
        cells = np.clip(np.floor(grid.to_unit(places) * (last + 1)), 0, last).astype(np.int64)
        return shade(replace(batch, corners_world=corners), replace(fragments, keys=morton_encode(cells)))

    return upright


def _back_share(light: np.ndarray, where: np.ndarray, lit: np.ndarray, through: np.ndarray) -> np.ndarray:
    """Share (F,) float32 of the back in the one luminance of fragments with light (F, 2) found `where` (F, 2)."""
    front, back = light.T
    fine = where == FINELY
    only_front, only_back = fine[:, FRONT] & ~fine[:, BACK], fine[:, BACK] & ~fine[:, FRONT]
    share = np.where(through, np.float32(0.5), only_back.astype(np.float32))
    share[(front < _DARK * back) & (through | ~only_front)] = 1.0
    share[through & (back < _DARK * front)] = 0.0
    share[lit == LIT_FRONT], share[lit == LIT_BACK] = 0.0, 1.0
    return share


@device
def _found(keys, slots, cell, face, sheet):
    return row_of_key(slots, keys, mixed(mixed(cell, np.int64(face)), np.int64(sheet)))


@kernel
def _look_up(first, last, places, sheets, cells, lights, where):
    """Write the light of both sides of fragments, and where it was found."""
    key, triangle, level = places.keys, places.triangle, places.level
    keys, slots, light = cells.keys, cells.slots, cells.light
    low, top = min(places.above, level), min(COARSE, level)
    above = np.uint64(3 * low)
    for f in range(first, last):
        t = triangle[f]
        if f > first and t == triangle[f - 1] and key[f] >> above == key[f - 1] >> above:  # as for most
            lights[f], where[f] = lights[f - 1], where[f - 1]
            continue
        for side in range(2):
            if not is_lit(sheets.lit[t], side):
                continue
            face = np.int64(sheets.face[t]) ^ side
            row = np.int64(-1)
            for up in range(low, top + 1):
                cell = ((key[f] >> np.uint64(3 * up)) << np.uint64(LEVEL_BITS)) | np.uint64(level - up)
                row = _found(keys, slots, cell, face, side_of_sheet(sheets.sheet[t], side))
                if row >= 0:
                    break
            for up in range(low, top + 1):
                if row < 0:
                    cell = ((key[f] >> np.uint64(3 * up)) << np.uint64(LEVEL_BITS)) | np.uint64(level - up)
                    row = _found(keys, slots, cell, face, ANY_SHEET)
            if row < 0:
                row = _found(keys, slots, cell, ANY_FACE, ANY_SHEET)
            if row < 0:
                continue
            where[f, side] = FINELY if cells.pixels[row] > 0.0 else COARSELY
            for c in range(light.shape[1]):
                lights[f, side, c] = light[row, c]
