# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoised light: kernel against reference, less error, no leaks across walls and edges."""

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.charts import Charts, layout_charts
from patchnet.patchnet_addon.lightmap.denoised_atlas import (
    REACH,
    Texels,
    _points,
    cells_of,
    denoise,
    denoised_atlas,
    placed_texels,
)
from patchnet.patchnet_addon.lightmap.texel_bases import BatchTexels, _owned
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleBatch, TriangleMesh
from patchnet.tests.references.light_map import denoise_reference, texel_places_reference

PATHS = 4


def grid_texels(side: int = 40, height: float = 0.0, normal: tuple[float, ...] = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Points (side^2, 3) of a square of texels of side 1."""
    x, y = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    return np.stack([x.ravel(), y.ravel(), np.full(side * side, height)], axis=1)


def texels(points: np.ndarray, truth: np.ndarray, rng: np.random.Generator, **more: np.ndarray) -> Texels:
    """Texels whose light has the noise of PATHS paths, of which the half difference is known."""
    count = len(points)
    halves = truth * rng.gamma(PATHS / 2, 2 / PATHS, (2, count))
    values = {
        "points": points,
        "normals": np.tile([0.0, 0.0, 1.0], (count, 1)),
        "size": np.ones(count),
        "material": np.zeros(count, np.int32),
        "light": halves.mean(axis=0)[:, None],
        "variance": ((halves[0] - halves[1]) / 2) ** 2,
        "weight": np.full(count, float(PATHS)),
    } | more
    kinds = (np.float32, np.float32, np.float32, np.int32, np.float32, np.float32, np.float32)
    return Texels(*(np.asarray(values[name], kind) for name, kind in zip(Texels._fields, kinds, strict=True)))


def denoised(given: Texels) -> np.ndarray:
    """(N,) denoised light in the order of the texels that were given."""
    order, cells = cells_of(given.points, given.size, 1.0, given.points.min(axis=0))
    found = np.empty_like(given.light)
    found[order] = denoise(Texels(*(column[order] for column in given)), cells)
    return found[:, 0]


@pytest.mark.parametrize("count", [1, 2, 333])
@pytest.mark.parametrize("channels", [1, 3])
def test_kernel_and_reference_agree(count: int, channels: int) -> None:
    """To the rounding of single precision, with points, normals, sizes and materials of all kinds."""
    rng = np.random.default_rng(count)
    normals = rng.normal(size=(count, 3)) * [0.3, 0.3, 1.0]
    normals[rng.random(count) < 0.2] = [1.0, 0.0, 0.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    given = texels(
        rng.uniform(0, 14, (count, 3)) * [1.0, 1.0, 0.1], rng.uniform(0.5, 1.0, count), rng,
        normals=normals, size=rng.choice([1.0, 1.2, 2.0], count), material=rng.integers(0, 2, count),
        light=rng.random((count, channels)),
    )  # fmt: skip
    order, cells = cells_of(given.points, given.size, 1.0, np.zeros(3))
    given = Texels(*(column[order] for column in given))
    np.testing.assert_allclose(denoise(given, cells), denoise_reference(given, cells), rtol=2e-4, atol=1e-6)


def test_a_cell_knows_its_neighbours() -> None:
    rng = np.random.default_rng(0)
    points, size = rng.uniform(0, 60, (500, 3)), rng.choice([1.0, 4.0], 500)
    order, cells = cells_of(points, size, 1.0, np.zeros(3))
    points, size = points[order], size[order]
    assert cells.first[0] == 0 and cells.first[-1] == 500
    cell = np.repeat(np.arange(len(cells.around)), np.diff(cells.first))
    for p in range(0, 500, 7):
        near = np.linalg.norm(points - points[p], axis=1) <= REACH * size[p]
        wanted = np.flatnonzero(near & (size == size[p]))
        assert np.isin(cell[wanted], cells.around[cell[p]]).all()


def test_a_shadow_edge_keeps_its_place() -> None:
    rng = np.random.default_rng(0)
    points = grid_texels()
    truth = np.where(points[:, 0] < 20.0, 1.0, 0.05)
    given = texels(points, truth, rng)
    edge = np.abs(points[:, 0] - 20.0) < 2.0
    before, after = (((light - truth) ** 2)[edge].mean() for light in (given.light[:, 0], denoised(given)))
    assert after < before
    dark = edge & (points[:, 0] > 20.0)
    assert denoised(given)[dark].mean() < 0.2


def test_light_crosses_neither_wall_nor_edge_nor_material() -> None:
    """A floor, dark behind a wall without thickness, whose light is as noisy as the step is high; and its ceiling."""
    rng = np.random.default_rng(0)
    floor, ceiling = grid_texels(24), grid_texels(24, height=1.0)
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(24) + 0.5, np.arange(4) + 0.5))
    wall = np.stack([np.full(len(y), 12.0), y, z], axis=1)
    down, across = np.tile([0.0, 0.0, -1.0], (len(ceiling), 1)), np.tile([1.0, 0.0, 0.0], (len(wall), 1))
    normals = np.concatenate([np.tile([0.0, 0.0, 1.0], (len(floor), 1)), down, across])
    points = np.concatenate([floor, ceiling, wall])
    lit = (points[:, 0] < 12.0) & (np.arange(len(points)) < len(floor))
    # So noisy that statistics would mix all: what is kept apart is kept apart by the surface.
    noise = np.full(len(points), 100.0)
    given = texels(points, np.ones(len(points)), rng, normals=normals, light=lit[:, None] * 1.0, variance=noise)
    found = denoised(given)
    np.testing.assert_array_equal(found[lit], 1.0)
    np.testing.assert_array_equal(found[~lit], 0.0)
    open_floor = texels(
        floor, np.ones(len(floor)), rng, light=lit[: len(floor), None] * 1.0, variance=noise[: len(floor)]
    )
    mixed = denoised(open_floor)
    assert ((mixed > 0.2) & (mixed < 0.8)).sum() > 20, "without the wall the same light mixes"
    kinds = (floor[:, 0] > 12.0).astype(np.int32)
    apart = denoised(open_floor._replace(material=kinds))
    np.testing.assert_array_equal(apart, open_floor.light[:, 0])


def squares(material: Material) -> TriangleMesh:
    """Two squares of 16 m, side by side, of four triangles."""
    corners = []
    for x in (0.0, 16.0):
        a, b, c, d = (np.array([x + u, v, 0.0]) for u, v in ((0, 0), (16, 0), (16, 16), (0, 16)))
        corners += [[a, b, c], [a, c, d]]
    uvs = np.array(corners)[..., :2].astype(np.float32) / 16.0
    batch = TriangleBatch(np.array(corners), uvs, np.zeros(4, np.int32), 0)
    return TriangleMesh((batch,), (material,))


def own_texels(charts: Charts) -> BatchTexels:
    """All texels of a surface of one batch."""
    index, triangle = _owned(charts)
    corners = charts.corner_texels(np.arange(len(charts.page)))
    return BatchTexels(index, triangle.astype(np.int64), corners, charts.page_side)


def atlas_of(source: TriangleMesh, truth: object, colored: bool = False) -> tuple[Atlas, np.ndarray, np.ndarray]:
    """Noisy atlas of light that is a function of points (n, 3); its texels in use, and what is true there."""
    charts = drain(layout_charts(source, 1.0, samples=PATHS, page_side=64))
    own = own_texels(charts)
    index = own.texels
    places = texel_places_reference(own)[:, 0]
    points = _points(next(iter(source.batches())), own.triangles, places)
    values = truth(points)  # type: ignore[operator]
    rng = np.random.default_rng(0)
    halves = values * rng.gamma(PATHS / 2, 2 / PATHS, (2, len(values)))
    texels = np.zeros((charts.texel_count, 4 if colored else 2), np.float32)
    noise = np.zeros(charts.texel_count, np.float32)
    texels[index, 0], texels[index, 1], noise[index] = halves.mean(axis=0), 1.0, (halves[0] - halves[1]) / 2
    if colored:
        texels[index, 2], texels[index, 3] = 1.5 * texels[index, 0], 0.5 * texels[index, 0]
    return Atlas(charts, texels, PATHS, noise=noise), index, values


@pytest.mark.parametrize("colored", [False, True])
def test_an_atlas_is_denoised_across_its_triangles(colored: bool) -> None:
    atlas, index, truth = atlas_of(squares(Material("Wall", (0.5, 0.5, 0.5))), lambda p: 1.0 + p[:, 0] / 40.0, colored)
    found = denoised_atlas(atlas, squares(Material("Wall", (0.5, 0.5, 0.5))))
    before, after = ((each.texels[index, 0] - truth) ** 2 for each in (atlas, found))
    assert found.noise is None and after.mean() < before.mean() / 8.0
    np.testing.assert_array_equal(found.texels[:, 1], atlas.texels[:, 1])
    if colored:
        np.testing.assert_allclose(found.texels[index, 2], 1.5 * found.texels[index, 0], rtol=1e-4)
        np.testing.assert_allclose(found.texels[index, 3], 0.5 * found.texels[index, 0], rtol=1e-4)
    assert denoised_atlas(found, squares(Material("Wall"))) is found
    lamp = squares(Material("Lamp", emission=(1.0, 1.0, 1.0)))
    np.testing.assert_array_equal(denoised_atlas(atlas, lamp).texels, atlas.texels)


@pytest.mark.parametrize("colored", [False, True])
def test_what_is_black_stays_black_beside_what_is_lit(colored: bool) -> None:
    """Half of each square has a base colour of next to nothing: noise there says nothing of light."""
    halves = np.where(np.arange(16) < 8, 0.8, 0.001).astype(np.float32)
    image = Texture("Halves", np.repeat(np.tile(halves, (16, 1))[..., None], 3, axis=2))
    source = squares(Material("Wall", (1.0, 1.0, 1.0), image))
    atlas, index, truth = atlas_of(source, lambda points: halves[(points[:, 0] % 16.0).astype(int)] * 1.0, colored)
    found = denoised_atlas(atlas, source)
    before, after = (each.texels[index, 0] - truth for each in (atlas, found))
    place, _, texels = placed_texels(atlas, source)
    across = texels.points[np.argsort(place)][np.searchsorted(np.sort(place), index), 0] % 8.0
    clear = (across > 1.0) & (across < 7.0)  # a lookup beside the halves' border mixes both
    black = (truth < 0.01) & clear
    assert black.sum() > 100 and np.abs(after[black]).max() < 0.005
    lit = (truth > 0.01) & clear
    assert (after[lit] ** 2).mean() < (before[lit] ** 2).mean() / 5.0
