# SPDX-License-Identifier: GPL-3.0-or-later
"""Look-up of baked light by fragments, against one in a dictionary; the one luminance of two sides."""

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.hashing import fill_slots, slots_for
from patchnet.patchnet_addon.cells.morton import morton_decode
from patchnet.patchnet_addon.light.light_cells import (
    ANY_FACE,
    ANY_SHEET,
    CellGrid,
    LightCells,
    surface_of_surfels,
)
from patchnet.patchnet_addon.light.seen_cells import SeenCells
from patchnet.patchnet_addon.light.sheets import Sheets
from patchnet.patchnet_addon.light.surface_light import (
    COARSELY,
    FINELY,
    NOWHERE,
    MaterialSides,
    _back_share,
    cells_shade,
    upright_shade,
)
from patchnet.patchnet_addon.light.surfels import COARSE, choose_surfels
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import (
    Material,
    RotatedSource,
    TriangleBatch,
    TriangleMesh,
    random_rotation,
)
from patchnet.patchnet_addon.surface.sides import BACK, FRONT
from patchnet.patchnet_addon.surface.textures import LEAST_BASE, TextureTable
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.tests.references.clip import centroids, each_fragment, parts_of
from patchnet.tests.references.surfels import Cell, Place, face_reference, key_of, lookup_reference

from .light_samples import FLAT_GRID, NO_EYES, partly_seen, random_layout, random_surface, sheet_surface, sums_of
from .mesh_samples import box, even, square

GRID = Grid((0.0, 0.0, 0.0), 1.0, 5)
MATERIALS = (Material("pink", (0.8, 0.4, 0.5)), Material("black", (0.0, 0.0, 0.0)), Material("lamp", (0.3, 0.3, 0.3)))
REFLECTS, THROUGH = np.array([True, True, False]), np.array([True, False, False])
BASES = np.array([(np.dot((0.2126, 0.7152, 0.0722), (0.8, 0.4, 0.5)), 0.8, 0.4, 0.5), [LEAST_BASE] * 4, [1.0] * 4])


def table_of(cells: dict[Place, Cell]) -> LightCells:
    keys = np.array([key_of(place) for place in cells], np.uint64)
    slots = slots_for(len(keys))
    fill_slots(slots, keys, np.arange(len(keys)))
    light, noise, radiance, pixels = (np.array(column, np.float32) for column in zip(*cells.values(), strict=True))
    return LightCells(keys, slots, light, noise, radiance, pixels)


def random_cells(clipped: ClippedSurface, sheets: Sheets, seed: int) -> dict[Place, Cell]:
    """Cells above leaves, each way to find light for a part of them; some are coarse, some in the dark."""
    rng = np.random.default_rng(seed)

    def random_cell() -> Cell:
        return Cell(rng.random(4) * rng.choice([1.0, 1e-3]), 0.0, 0.0, float(rng.choice([0.0, 1.0])))

    cells: dict[Place, Cell] = {}
    for batch, fragments, f, key, t in each_fragment(clipped):
        level, normal = fragments.level, triangle_areas_and_normals(batch.corners_world)[1][fragments.triangle[f]]
        for up in range(min(COARSE, level) + 1):
            cell = (key >> 3 * up) << 5 | level - up
            for side, sign in enumerate((1.0, -1.0)):
                face = face_reference(sign * normal)
                ways = [
                    (cell, face, 2 * int(sheets.sheet[t]) + side),
                    (cell, face, ANY_SHEET),
                    (cell, ANY_FACE, ANY_SHEET),
                ]
                for place, chance in zip(ways, (0.06, 0.06, 0.5), strict=True):
                    if place not in cells and key_of(place) % 1000 < 1000 * chance:
                        cells[place] = random_cell()
    return cells


def painted(source: TriangleMesh) -> TriangleMesh:
    """The same triangles with three materials in turn."""
    parts = []
    for batch in source.parts:
        materials = ((batch.first_triangle + np.arange(len(batch))) % len(MATERIALS)).astype(np.int32)
        parts.append(TriangleBatch(batch.corners_world, batch.uvs, materials, batch.first_triangle))
    return TriangleMesh(tuple(parts), MATERIALS)


def test_the_back_of_a_leaf_is_not_the_front_of_another() -> None:
    """Of a hollow wall, whose leaves are one open sheet: the outer one is lit from outside, the inner one's back dark.

    Coarse light cells hold both, and they face alike.
    """
    corners = np.concatenate([square(0.32), square(0.30)[:, ::-1]])  # the inner one's back faces up
    source, sheets = sheet_surface(corners)
    clipped, nothing = ClippedSurface(source, FLAT_GRID), np.empty(0, np.uint64)
    seen = SeenCells(nothing, np.empty(0, np.int64), np.empty(0, np.float32))
    surfels = drain(choose_surfels(clipped, even(), sheets, seen, NO_EYES))
    table = TextureTable.from_materials(source.materials)
    surface = surface_of_surfels(surfels, source, table, np.zeros(1, bool), color=False)
    outside = (surface.place[:, 2] > 0.31) & (surface.normal[:, 2] > 0.0)
    inside = (surface.place[:, 2] < 0.31) & (surface.normal[:, 2] < 0.0)
    lit = np.where(outside | inside, 1.0, 0.0)
    cells = CellGrid(surfels, surface, FLAT_GRID, filtered=False).light(sums_of(np.stack([lit, lit], axis=1)))
    sides = MaterialSides(np.zeros(1, bool), np.zeros(1, bool))
    shade = cells_shade(cells, table, sheets, sides, color=False)
    for batch, fragments in parts_of(clipped):
        lights = shade(batch, fragments).sides[..., 0]
        np.testing.assert_array_equal(lights[:, FRONT], 1.0)
        np.testing.assert_array_equal(lights[:, BACK], 0.0)


@pytest.mark.parametrize("color", [False, True])
def test_as_a_look_up_in_a_dictionary(color: bool) -> None:
    """Light of both sides is in single precision that of the cell times the base colour."""
    plain, sheets = random_surface(3)
    source = painted(plain)
    clipped = ClippedSurface(source, GRID, random_layout(3))
    cells = random_cells(clipped, sheets, 3)
    channels = 4 if color else 1
    light = table_of({place: cell._replace(light=cell.light[:channels]) for place, cell in cells.items()})
    table = TextureTable.from_materials(source.materials, color=color)
    shade = cells_shade(light, table, sheets, MaterialSides(REFLECTS, THROUGH), color=color)
    seen = set()
    for batch, fragments in parts_of(clipped):
        luminance, opacity, mean, lights, lit = shade(batch, fragments)
        np.testing.assert_array_equal(lit, sheets.lit[batch.first_triangle : batch.first_triangle + len(batch)])
        normals = triangle_areas_and_normals(batch.corners_world)[1]
        assert lights.shape == (len(fragments), 2, channels) and mean.shape == (len(fragments) if color else 0, 3)
        np.testing.assert_array_equal(opacity, 1.0)
        where = np.full((len(fragments), 2), NOWHERE)
        expected = np.zeros(lights.shape)
        lit = sheets.lit[batch.first_triangle + fragments.triangle]
        materials = batch.materials[fragments.triangle]
        for f in range(len(fragments)):
            t = int(fragments.triangle[f])
            for side, sign in enumerate((1.0, -1.0)):
                face = face_reference(sign * normals[t])
                sheet = 2 * int(sheets.sheet[batch.first_triangle + t]) + side
                cell = lookup_reference(cells, int(fragments.keys[f]), fragments.level, face, sheet)
                if cell is not None and lit[f] != -sign:
                    expected[f, side] = (cell.light * BASES[materials[f]])[:channels]
                    where[f, side] = FINELY if cell.pixels > 0.0 else COARSELY
        seen |= set(where.ravel().tolist())
        np.testing.assert_allclose(lights, expected, rtol=1e-5)
        back = _back_share(lights[..., 0], where, lit, THROUGH[materials])
        np.testing.assert_allclose(
            luminance, (1.0 - back) * expected[:, 0, 0] + back * expected[:, 1, 0], rtol=1e-5, atol=1e-9
        )
        if color:  # brought to its luminance
            weighted = mean @ np.array([0.2126, 0.7152, 0.0722])
            np.testing.assert_allclose(weighted, luminance, rtol=1e-4, atol=1e-9)
    assert seen == {NOWHERE, COARSELY, FINELY}


@pytest.mark.parametrize("eyes", [NO_EYES, np.array([(0.5, 0.4, 0.45, 1.0)])], ids=["all", "eye"])
@pytest.mark.parametrize("layout", [None, random_layout(5)], ids=["even", "layout"])
@pytest.mark.parametrize("seed", range(3))
def test_light_of_surfels_reaches_all_fragments(seed: int, layout: LeafLevels | None, eyes: np.ndarray) -> None:
    """Each lit side gets the one light that was baked, whatever cell, sheet or mean it is found in, and no other."""
    source, sheets = random_surface(seed)
    clipped = ClippedSurface(source, GRID, layout)
    seen = partly_seen(clipped, even(), seed)
    surfels = drain(choose_surfels(clipped, even(), sheets, seen, eyes))
    table = TextureTable.from_materials(source.materials)
    surface = surface_of_surfels(surfels, source, table, np.ones(1, bool), color=False)
    cells = CellGrid(surfels, surface, GRID, filtered=True).light(sums_of(np.full((len(surfels), 2), 3.0)))
    shade = cells_shade(cells, table, sheets, MaterialSides(np.ones(1, bool), np.zeros(1, bool)), color=False)
    for batch, fragments in parts_of(clipped):
        luminance, _, _, lights, _ = shade(batch, fragments)
        lit = sheets.lit[batch.first_triangle + fragments.triangle]
        there = fragments.area_world > 0.0
        np.testing.assert_allclose(lights[there, :, 0], np.where(np.stack([lit < 0, lit > 0], 1), 0.0, 3.0)[there])
        np.testing.assert_allclose(luminance[there], 3.0)


FINE, ONLY_BACK, BOTH_COARSE = (FINELY, FINELY), (COARSELY, FINELY), (COARSELY, COARSELY)


@pytest.mark.parametrize(
    ("front", "back", "where", "lit", "through", "share"),
    [
        (1.0, 1.0, FINE, 0, False, 0.0),
        (0.01, 1.0, FINE, 0, False, 1.0),  # the front is enclosed
        (0.03, 1.0, FINE, 0, False, 0.0),
        (1.0, 1.0, BOTH_COARSE, 0, False, 0.0),
        (1.0, 0.5, ONLY_BACK, 0, False, 1.0),
        (1.0, 0.001, ONLY_BACK, 0, False, 1.0),  # dark where cameras look
        (0.5, 1.0, (NOWHERE, FINELY), 0, False, 1.0),
        (0.5, 1.0, (FINELY, COARSELY), 0, False, 0.0),
        (1.0, 1.0, FINE, 0, True, 0.5),
        (0.0, 1.0, FINE, 0, True, 1.0),
        (1.0, 0.0, FINE, 0, True, 0.0),
        (0.0, 0.0, FINE, 0, True, 0.5),
        (1.0, 0.5, ONLY_BACK, 0, True, 0.5),
        (0.0, 1.0, ONLY_BACK, 1, True, 0.0),  # the back gets no light
        (1.0, 0.0, FINE, -1, False, 1.0),
    ],
)
def test_the_side_that_counts(
    front: float, back: float, where: tuple[int, int], lit: int, through: bool, share: float
) -> None:
    light, found = np.array([[front, back]], np.float32), np.array([where], np.uint8)
    assert _back_share(light, found, np.array([lit]), np.array([through])).tolist() == [share]


@pytest.mark.parametrize("seed", range(2))
def test_a_rotated_surface_has_the_light_of_the_upright_one(seed: int) -> None:
    """Light of a cell is the first coordinate of its centre, and differs from face to face."""
    corners = box((0.13, 0.22, 0.31), (0.83, 0.77, 0.69))
    source, sheets = sheet_surface(corners, lit=1)
    cells: dict[Place, Cell] = {}
    normals = triangle_areas_and_normals(next(source.batches()).corners_world)[1]
    for _, fragments, _, key, t in each_fragment(ClippedSurface(source, GRID)):
        face = face_reference(normals[t])
        x = (morton_decode(np.uint64(key >> 3))[0] + 0.5) / (1 << fragments.level - 1)
        cells[(key >> 3) << 5 | fragments.level - 1, face, 0] = Cell(np.array([10.0 * face + x]), 0.0, 0.0, 1.0)
    table, sides = TextureTable.from_materials(source.materials), MaterialSides(np.zeros(1, bool), np.zeros(1, bool))
    shade = cells_shade(table_of(cells), table, sheets, sides, color=False)
    rotation = random_rotation(seed)
    rotated = RotatedSource(source, rotation)
    upright = upright_shade(shade, rotation, GRID)
    count = 0
    for batch, fragments in parts_of(ClippedSurface(rotated, Grid.around(rotated.bounds_world, 5))):
        luminance, _, _, lights, _ = upright(batch, fragments)
        x = centroids(corners, fragments)[:, 0]
        faces = np.array([face_reference(normal) for normal in normals])[fragments.triangle]
        found = luminance > 0.0  # a few centroids lie in leaves of other sides, to the last bit
        count += found.sum()
        assert found.mean() > 0.999
        assert (np.abs(luminance - 10.0 * faces - x)[found] < 0.5 / 16 + 1e-5).all()
        np.testing.assert_array_equal(lights[:, 0, 0], luminance)
    assert count > 1000
