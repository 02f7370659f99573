# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of cells from baked surfels: means, noise and the filter against loops; what the filter keeps apart."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.morton import morton_decode
from patchnet.patchnet_addon.light.cell_filter import STEPS
from patchnet.patchnet_addon.light.light_cells import (
    ANY_FACE,
    ANY_SHEET,
    MIN_OPACITY,
    CellGrid,
    LightCells,
    SurfelSums,
    SurfelSurface,
    reflecting,
    surface_of_surfels,
)
from patchnet.patchnet_addon.light.rounds import picture_noise
from patchnet.patchnet_addon.light.seen_cells import LEVEL_BITS, SeenCells, all_cells
from patchnet.patchnet_addon.light.surfels import SURFEL, choose_surfels
from patchnet.patchnet_addon.lod.fit import leaf_keys_of
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleMesh
from patchnet.patchnet_addon.surface.sides import BACK
from patchnet.patchnet_addon.surface.textures import LEAST_BASE, TextureTable
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.tests.references.surfels import Spot, all_neighbours, key_of, light_cells_reference

from .light_samples import FLAT_GRID, NO_EYES, plain_surface, random_surface, sheets_on, sums_of, surfels_of
from .mesh_samples import even, in_batches, square
from .test_hashing import find_rows

UP = 4  # face of a square that faces up


def light_of(
    surfels: np.ndarray, surface: SurfelSurface, sums: SurfelSums, *, filtered: bool, grid: Grid = FLAT_GRID
) -> LightCells:
    return CellGrid(surfels, surface, grid, filtered=filtered).light(sums)


def random_bake(seed: int, *, color: bool) -> tuple[np.ndarray, SurfelSurface, SurfelSums]:
    """Surfels of a random surface with light through gaps, of a third of the cells without any."""
    rng = np.random.default_rng(seed)
    source, sheets = random_surface(seed)
    surfels = surfels_of(source, sheets, grid=replace(FLAT_GRID, depth=5))
    surfels["pixels"] *= rng.uniform(0.1, 4.0, len(surfels)).astype(np.float32)
    table = TextureTable.from_materials(source.materials, color=color)
    surface = surface_of_surfels(surfels, source, table, reflecting(table, [True]), color=color)
    channels, count = surface.base.shape[1], len(surfels)
    surface = surface._replace(
        base=rng.uniform(0.1, 1.0, (count, channels)).astype(np.float32),
        is_filtered=(surfels["cell"] >> np.uint64(5)) % 5 > 0,
    )
    sums = SurfelSums.zeros(count, channels + 2)
    for part in range(1, 4):
        mine = np.flatnonzero(rng.random(count) < 1.0 / part)
        opacity = rng.choice([1.0, 0.3, 1e-5], (len(mine), 1)) * ((surfels["cell"][mine, None] >> np.uint64(5)) % 3 > 0)
        light = rng.uniform(0.8, 1.2, (len(mine), channels)) * opacity
        half = rng.normal(scale=0.2, size=(len(mine), 1)) * opacity
        sums.add(mine, np.concatenate([light, opacity, half], axis=1), 4 * part)
    return surfels, surface, sums


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("color", [False, True])
def test_as_loops_over_a_dictionary(filtered: bool, color: bool) -> None:
    """Light and noise are stored in single precision after each pass; small noise is the root of a difference.

    The cube of the octree is not that of the world.
    """
    surfels, surface, sums = random_bake(1, color=color)
    surface = surface._replace(place=3.0 * surface.place - [1.0, 2.0, 5.0])
    grid = Grid((-1.0, -2.0, -5.0), 3.0, 5)
    cells = light_of(surfels, surface, sums, filtered=filtered, grid=grid)
    expected = light_cells_reference(surfels, surface, sums, grid, filtered=filtered)
    rows = rows_of(cells, [key_of(place) for place in expected])
    assert (rows >= 0).all() and len(np.unique(rows)) == len(rows) == (cells.slots > 0).sum() > 500
    for name in ("light", "noise", "radiance", "pixels"):
        wanted = np.array([getattr(cell, name) for cell in expected.values()])
        np.testing.assert_allclose(
            getattr(cells, name)[rows], wanted, rtol=2e-5, atol=1e-4 if name == "noise" else 1e-6, err_msg=name
        )
    own = [tuple(int(one[name]) for name in ("cell", "face", "sheet")) for one in surfels]
    assert cells.keys[: len(own)].tolist() == [key_of(place) for place in own]
    found = rows_of(cells, cells.keys[: len(own)])
    assert found.tolist() == [i if place in expected else -1 for i, place in enumerate(own)] and (found < 0).any()


def rows_of(cells: LightCells, keys: list[int] | np.ndarray) -> np.ndarray:
    """Rows of some keys among those in the slots, -1 for none."""
    found = np.empty(len(keys), np.int64)
    find_rows(cells.slots, cells.keys, np.array(keys, np.uint64), found)
    return np.maximum(found, -1)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("step", STEPS)
def test_neighbours_are_those_around_points_in_the_plane(step: int, seed: int) -> None:
    surfels, surface, _ = random_bake(seed, color=False)
    near = CellGrid(surfels, surface, replace(FLAT_GRID, depth=5), filtered=True)._neighbours[STEPS.index(step)]
    own = [tuple(int(one[name]) for name in ("cell", "face", "sheet")) for one in surfels]
    seen = surfels["pixels"] > 0.0
    spots = {
        where: Spot(*spot)
        for where, *spot in zip(own, surface.place, surface.normal, surface.is_filtered, seen, strict=True)
    }
    all_of_them = all_neighbours(spots, step)
    for i, where in enumerate(own):
        mine = slice(*near.first[i : i + 2])
        found = sorted((own[row], weight) for row, weight in zip(near.rows[mine], near.weights[mine], strict=True))
        expected = sorted(all_of_them[where].items())
        assert [other for other, _ in found] == [other for other, _ in expected]
        np.testing.assert_allclose([weight for _, weight in found], [weight for _, weight in expected], rtol=1e-5)
    assert len(near.rows) > (100 if step < 8 else 20)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("facing", [1, -1])
@pytest.mark.parametrize("rounding", [0.0, 1e-9])
def test_cells_of_a_wall_have_all_their_neighbours(axis: int, facing: int, rounding: float) -> None:
    """Eight within the wall, five at its edges, three at its corners; fewer two and four cells away.

    Places may lie beyond the cell, by the rounding of their weights: then they are still not neighbours of their own.
    """
    corners = np.roll(square(0.3), axis, axis=2)[:, ::facing]
    source = TriangleMesh.from_arrays(corners)
    surfels = surfels_of(source, sheets_on(corners, np.zeros(2), 1))
    table = TextureTable.from_materials(source.materials)
    surface = surface_of_surfels(surfels, source, table, reflecting(table, [True]), color=False)
    fine = np.flatnonzero(surfels["pixels"] > 0.0)
    assert len(fine) == 26 * 26
    if rounding:  # at the corner of the cell that has the highest coordinates, a little beyond it
        side = 0.5 ** (surfels["cell"] & np.uint64(31)).astype(np.float64)[:, None]
        corner = (np.floor(surface.place / side) + 1.0) * side + rounding
        in_plane = np.arange(3) != (axis + 2) % 3
        surface = surface._replace(place=np.where(in_plane, corner, surface.place))
    for step, near in zip(STEPS, CellGrid(surfels, surface, FLAT_GRID, filtered=True)._neighbours, strict=True):
        assert near.first[-1] == len(near.rows) == len(near.weights)
        if rounding:
            owner = np.repeat(np.arange(len(surfels)), np.diff(near.first))
            level = surfels["cell"] & np.uint64(31)
            assert (near.rows != owner).all() and (level[near.rows] == level[owner]).all()
            pairs = set(zip(owner.tolist(), near.rows.tolist(), strict=True))
            assert len(pairs) == len(near.rows) and pairs == {(row, own) for own, row in pairs}
            continue
        counts = np.diff(near.first)[fine]
        inner, edge = (26 - 2 * step) ** 2, 4 * step * (26 - 2 * step)
        assert np.unique(counts, return_counts=True)[1].tolist() == [4 * step**2, edge, inner]
        assert np.unique(counts).tolist() == [3, 5, 8]
        np.testing.assert_array_less(0.5, near.weights)


def test_sums_are_means_over_all_paths() -> None:
    sums = SurfelSums.zeros(3, 2)
    sums.add(np.array([0, 2]), np.array([[1.0, 2.0], [3.0, 4.0]], np.float32), 4)
    sums.add(np.array([2]), np.array([[6.0, 1.0]], np.float32), 8)
    np.testing.assert_allclose(sums.light, [[4, 8], [0, 0], [60, 24]])
    assert sums.samples.tolist() == [4, 0, 12]


def test_light_that_varies_over_a_surfel_is_no_noise_once_there_are_two_rounds() -> None:
    """Parts that differ by 2 in every round, and noise of 1 a path, of which 16 paths leave 1/4, and 64 paths 1/8."""
    rng, count = np.random.default_rng(7), 4000
    sums = SurfelSums.zeros(count, 3)
    for samples, wanted in ((4, np.hypot(1.0, 0.5)), (12, 0.25), (48, 0.125)):
        parts = rng.normal(size=(count, 2, samples // 2)).mean(axis=2) + [1.0, -1.0]
        half = 0.5 * (parts[:, 0] - parts[:, 1])
        sums.add(np.arange(count), np.stack([parts.mean(axis=1), np.ones(count), half], axis=1), samples)
        assert np.sqrt(np.mean(sums.half**2)) == pytest.approx(wanted, rel=0.05)


def textured() -> TriangleMesh:
    """Squares of five materials: a half red, half blue picture, an unknown, an emitter, black, and gray."""
    image = np.zeros((8, 8, 3), np.float32)
    image[:, :4], image[:, 4:] = (0.9, 0.1, 0.1), (0.1, 0.2, 0.8)
    materials = (
        Material("image", (1.0, 1.0, 1.0), Texture("image", image)),
        Material("unknown", (0.5, 0.5, 0.5), base_is_known=False),
        Material("lamp", (0.5, 0.5, 0.5), emission=(3.0, 3.0, 3.0)),
        Material("black", (0.0, 0.0, 0.0)),
        Material("gray", (0.5, 0.5, 0.5)),
    )
    corners = np.concatenate([square(0.1 + 0.15 * i) for i in range(5)])
    uvs = ((corners[..., :2] - 0.1) / 0.8).astype(np.float32)
    return TriangleMesh(in_batches(corners, (3, 4), uvs, np.repeat(np.arange(5), 2).astype(np.int32)), materials)


@pytest.mark.parametrize("color", [False, True])
def test_surface_at_surfels(color: bool) -> None:
    """Places lie in the leaf, on the triangle; base colours are those of a known, reflecting material, never black."""
    source = textured()
    corners = np.concatenate([batch.corners_world for batch in source.batches()])
    surfels = surfels_of(source, sheets_on(corners, np.repeat(np.arange(5), 2), 0))
    surfels = np.random.default_rng(0).permutation(surfels)
    table = TextureTable.from_materials(source.materials, color=color)
    reflects = reflecting(table, [material.base_is_known for material in source.materials])
    assert reflects.tolist() == [True, False, False, True, True]
    surface = surface_of_surfels(surfels, source, table, reflects, color=color)
    corners = corners[surfels["triangle"]]
    np.testing.assert_allclose(surface.place[:, 2], corners[:, 0, 2], atol=1e-7)
    leaves = morton_decode(surfels["leaf"] >> np.uint64(LEVEL_BITS))
    assert (np.abs(surface.place * 64 - leaves - 0.5) < 0.5 + 1e-5).all()
    up = triangle_areas_and_normals(corners)[1]
    np.testing.assert_allclose(surface.normal, np.where(surfels["side"] == BACK, -1.0, 1.0)[:, None] * up, atol=1e-12)
    np.testing.assert_array_equal(surface.material, surfels["triangle"] // 2)
    np.testing.assert_array_equal(surface.is_filtered, reflects[surface.material])
    assert surface.base.shape == (len(surfels), 4 if color else 1)
    x = surface.place[:, 0]
    clear = np.abs(x - 0.5) < 0.3  # of the middle of the picture, and of its border, where it repeats
    clear &= np.abs(x - 0.5) > 0.15
    for material, wanted in {1: 1.0, 2: 1.0, 3: LEAST_BASE, 4: 0.5}.items():
        np.testing.assert_allclose(surface.base[surface.material == material], wanted, rtol=1e-5)
    for left, rgb in ((True, (0.9, 0.1, 0.1)), (False, (0.1, 0.2, 0.8))):
        mine = surface.base[(surface.material == 0) & clear & ((x < 0.5) == left)]
        wanted = [np.dot((0.2126, 0.7152, 0.0722), rgb), *rgb][: mine.shape[1]]
        assert len(mine) > 20
        np.testing.assert_allclose(mine, np.tile(wanted, (len(mine), 1)), rtol=1e-3)


def wall(*heights: float, lit: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Surfels of squares that face up, each a sheet, as all leaves are seen; and places of these (N, 3)."""
    count = len(heights)
    corners = np.concatenate([square(height) for height in heights])
    source = TriangleMesh.from_arrays(corners)
    surfels = surfels_of(source, sheets_on(corners, np.repeat(np.arange(count), 2), lit))
    table = TextureTable.from_materials(source.materials)
    surface = surface_of_surfels(surfels, source, table, reflecting(table, [True]), color=False)
    return surfels, surface.place


def test_a_noisy_wall_becomes_smooth() -> None:
    """The filter leaves an eighth of the error at most; its noise tells that error, or half of it at least."""
    surfels, places = wall(0.3)
    surface = plain_surface(surfels, places, 0.5)
    light = 1.0 + 0.4 * np.random.default_rng(0).normal(size=(len(surfels), 2))
    error, noise = {}, {}
    for filtered in (False, True):
        cells = light_of(surfels, surface, sums_of(light), filtered=filtered)
        rows = np.flatnonzero(surfels["pixels"] > 0.0)
        error[filtered] = np.sqrt(np.mean((cells.radiance[rows] - 1.0) ** 2))
        noise[filtered] = np.sqrt(np.mean(cells.noise[rows] ** 2))
    assert len(rows) > 500
    assert noise[False] == pytest.approx(error[False], rel=0.1)
    assert error[True] < 0.125 * error[False] and 0.5 < noise[True] / error[True] < 1.1


def test_a_wall_has_no_step_where_its_cells_grow() -> None:
    """Cells of one half are twice as wide, and their light, noisier than that, is brighter by a tenth."""
    corners = square(0.3)
    source = TriangleMesh.from_arrays(corners)
    clipped = ClippedSurface(source, FLAT_GRID)
    leaves = all_cells(drain(leaf_keys_of(clipped, even())))
    right = morton_decode(leaves.cells >> np.uint64(LEVEL_BITS))[:, 0] >= 32
    seen = SeenCells(leaves.cells, np.where(right, 4, 5), np.ones(len(right), np.float32))
    surfels = drain(choose_surfels(clipped, even(), sheets_on(corners, np.zeros(2), 1), seen, NO_EYES))
    table = TextureTable.from_materials(source.materials)
    surface = surface_of_surfels(surfels, source, table, reflecting(table, [True]), color=False)
    surface, fine = surface._replace(base=np.ones_like(surface.base)), surfels["pixels"] > 0.0
    x, level = surface.place[:, 0], (surfels["cell"] & np.uint64((1 << LEVEL_BITS) - 1)).astype(np.int64)
    assert set(level[fine & (x < 0.5)]) == {5} and set(level[fine & (x > 0.5)]) == {4}
    plain = np.where(x < 0.5, 1.0, 1.1)
    sums = SurfelSums.zeros(len(surfels), 3)
    sums.add(np.arange(len(surfels)), np.stack([plain, np.ones(len(x)), np.full(len(x), 0.3)], axis=1), 4)
    light = light_of(surfels, surface, sums, filtered=True).light[: len(surfels), 0]
    middle = fine & (surface.place[:, 1] > 0.3) & (surface.place[:, 1] < 0.7)
    left, beyond = (light[middle & (np.abs(x - at) < 1 / 64)].mean() for at in (0.5 - 1 / 64, 0.5 + 1 / 64))
    far = light[middle & (x < 0.2)].mean(), light[middle & (x > 0.85)].mean()
    assert abs(beyond - left) < 0.03 and left > 1.02 and beyond < 1.08
    assert far[0] < 1.02 and far[1] > 1.08
    area = 0.25 ** level[fine]
    assert area @ light[fine] == pytest.approx(area @ plain[fine], rel=1e-6), "light is kept"


def test_noise_of_unequal_rounds_is_that_of_the_mean() -> None:
    """Paths of noise 1 in rounds of 4, 4 and 8, each in two parts: the mean's is a fourth, within a twentieth of it."""
    surfels, _ = wall(0.3)
    surfels = surfels[surfels["pixels"] > 0.0]
    rng, count = np.random.default_rng(4), len(surfels)
    sums = SurfelSums.zeros(count, 3)
    for samples in (4, 4, 8):
        paths = 5.0 + rng.normal(size=(count, 2, samples // 2)).mean(axis=2)
        means = np.stack([paths.mean(axis=1), np.ones(count), 0.5 * (paths[:, 0] - paths[:, 1])], axis=1)
        sums.add(np.arange(count), means, samples)
    surface = plain_surface(surfels, np.zeros((count, 3)))
    cells = light_of(surfels, surface, sums, filtered=False)
    alone = np.sqrt(np.mean(cells.noise[:count].astype(np.float64) ** 2))
    assert alone == pytest.approx(0.25, rel=0.05)


def test_a_shadow_keeps_its_edge() -> None:
    """Half of a wall in shadow; beside the edge, and it is one of cells, light stays within a fifth of the contrast."""
    surfels, places = wall(0.3)
    lit = np.where(places[:, 0] < 0.5, 1.0, 0.1)
    light = lit[:, None] * (1.0 + 0.1 * np.random.default_rng(1).normal(size=(len(surfels), 2)))
    cells = light_of(surfels, plain_surface(surfels, places), sums_of(light), filtered=True)
    fine = np.flatnonzero(surfels["pixels"] > 0.0)
    found = cells.light[fine, 0]
    near = np.abs(places[fine, 0] - 0.5) < 1.0 / 32.0
    assert near.sum() > 50
    assert np.abs(found - lit[fine])[near].max() < 0.2 * 0.9
    assert np.sqrt(np.mean((found - lit[fine])[near] ** 2)) < 0.05 * 0.9


@pytest.mark.parametrize("apart", ["sheets", "faces", "unfiltered"])
def test_the_filter_keeps_surfaces_apart(apart: str) -> None:
    """One has noisy light around 4, the other exactly 5 and as noisy: any mixing changes that."""
    surfels, places = wall(0.3, 0.301) if apart == "sheets" else wall(0.3, lit=0 if apart == "faces" else 1)
    surface = plain_surface(surfels, places)
    other = {
        "sheets": surfels["sheet"] == 2,  # the front of the second
        "faces": surfels["face"] != UP,
        "unfiltered": (surfels["cell"] >> np.uint64(5)) % 2 == 1,
    }[apart]
    if apart == "unfiltered":
        surface = surface._replace(is_filtered=~other)
    light = np.where(other[:, None], [4.0, 6.0], 4.0 + 2.0 * np.random.default_rng(2).normal(size=(len(surfels), 2)))
    plain, found = (light_of(surfels, surface, sums_of(light), filtered=how) for how in (False, True))
    assert 100 < other.sum() < len(other) - 100
    rows, mine = np.flatnonzero(other), np.flatnonzero(~other & (surfels["pixels"] > 0.0))
    np.testing.assert_allclose(found.light[rows], 5.0, rtol=1e-6)
    assert found.light[mine].std() < 0.5 * plain.light[mine].std()
    assert (abs(found.light[mine, 0].mean() - 4.0)) < 0.2
    if apart == "unfiltered":
        np.testing.assert_array_equal(found.noise[rows], plain.noise[rows])


def test_light_behind_gaps_is_that_of_what_is_opaque() -> None:
    surfels, places = wall(0.3)
    surface = plain_surface(surfels, places, 0.25)
    light = np.full((len(surfels), 2), 2.0)
    opacity = np.random.default_rng(3).choice([1.0, 0.25, 1e-4], len(surfels))
    cells = light_of(surfels, surface, sums_of(light, opacity), filtered=False)
    found = rows_of(cells, cells.keys)
    np.testing.assert_allclose(cells.light[found >= 0], 8.0, rtol=1e-6)
    np.testing.assert_allclose(cells.radiance[found >= 0], 2.0, rtol=1e-6)
    np.testing.assert_allclose(cells.noise, 0.0, atol=1e-3)
    np.testing.assert_array_equal(found[: len(surfels)] < 0, opacity < MIN_OPACITY)


@pytest.mark.parametrize("factor", [1e-9, 1e-6, 1e6])
@pytest.mark.parametrize("spread", [0.4, 0.0])
def test_the_filter_knows_no_unit_of_light(factor: float, spread: float) -> None:
    """Half of a wall is ten times as bright as the other; also where there is no noise."""
    surfels, places = wall(0.3)
    surface = plain_surface(surfels, places, 0.5)
    lit = np.where(places[:, :1] < 0.5, 1.0, 0.1)
    light = lit * (1.0 + spread * np.random.default_rng(6).normal(size=(len(surfels), 2)))
    plain, scaled = (light_of(surfels, surface, sums_of(unit * light), filtered=True) for unit in (1.0, factor))
    for name in ("light", "noise", "radiance"):
        wanted = getattr(plain, name)
        np.testing.assert_allclose(getattr(scaled, name) / factor, wanted, rtol=1e-3, atol=1e-3, err_msg=name)


@pytest.mark.parametrize("filtered", [False, True])
def test_without_light_there_are_no_cells(filtered: bool) -> None:
    surfels, places = wall(0.3)
    for some in (surfels, surfels[:0]):
        sums = sums_of(np.ones((len(some), 2)), 0.0)
        cells = light_of(some, plain_surface(some, places[: len(some)]), sums, filtered=filtered)
        assert not cells.slots.any() and not cells.light.any() and not cells.radiance.any()
        assert len(cells.keys) == len(cells.light) == len(cells.noise) == len(cells.pixels) >= len(some)


def test_pixels_of_a_mean_are_those_of_the_sheet_that_most_show() -> None:
    """Of three sheets in one cell; their light is weighted by what they stand for."""
    surfels = np.zeros(3, SURFEL)
    surfels["cell"], surfels["sheet"], surfels["share"], surfels["pixels"] = 33, range(3), [1, 2, 5], [0.25, 9.0, 1.0]
    light = np.repeat([[8.0], [4.0], [1.6]], 2, axis=1)
    cells = light_of(surfels, plain_surface(surfels, np.zeros((3, 3))), sums_of(light), filtered=False)
    rows = rows_of(cells, [key_of((33, 0, ANY_SHEET)), key_of((33, ANY_FACE, ANY_SHEET))])
    assert cells.pixels[rows].tolist() == [9.0, 9.0]
    np.testing.assert_allclose(cells.light[rows, 0], [3.0, 3.0], rtol=1e-6)


@pytest.mark.parametrize("filtered", [False, True])
def test_gaps_show_no_noise(filtered: bool) -> None:
    """Surfels whose paths met gaps alone get no further paths, among noisy ones; nor do those that no camera sees."""
    surfels, places = wall(0.3)
    light = 1.0 + 0.4 * np.random.default_rng(5).normal(size=(len(surfels), 2))
    gaps = np.arange(len(surfels)) % 3 == 0
    sums = sums_of(light, np.where(gaps, 1e-5, 1.0))
    cells = light_of(surfels, plain_surface(surfels, places), sums, filtered=filtered)
    assert not cells.pixels[: len(surfels)][gaps].any()
    noisy = picture_noise(cells)[: len(surfels)] > 1e-3
    assert not noisy[gaps | (surfels["pixels"] == 0.0)].any() and noisy.sum() > 200
