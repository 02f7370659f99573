# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts: each texel has one triangle, each triangle has a texel, lookups are exact; texel sizes follow leaf levels."""

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.atlas_shade import atlas_shade
from patchnet.patchnet_addon.lightmap.chart_lookup import lookup, texel_owners, triangle_means
from patchnet.patchnet_addon.lightmap.charts import Charts, layout_charts
from patchnet.patchnet_addon.lightmap.packing import SINGLE
from patchnet.patchnet_addon.lightmap.texel_sizes import texel_sizes
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments, Material, TriangleMesh


def triangles(count: int, seed: int = 0, spread: float = 1.5) -> np.ndarray:
    """Triangles (count, 3, 3) of very different sizes and shapes."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 3, 3)) * np.exp(rng.normal(size=(count, 1, 1)) * spread)
    corners[::7, 2] = corners[::7, 0] + 0.01 * (corners[::7, 2] - corners[::7, 0])  # slivers
    corners[::11] = corners[::11, :1]  # points
    return corners + rng.normal(size=(count, 1, 3)) * 10


def layout(corners: np.ndarray, texel: float, **settings: int) -> Charts:
    return drain(layout_charts(TriangleMesh.from_arrays(corners), texel, **settings))


def inside(charts: Charts, triangle: int) -> set[tuple[int, int]]:
    """Texels (x, y) whose centre is in the triangle of the chart, from its corners alone."""
    corners = charts.corner_texels(np.array([triangle]))[0]
    low, high = np.floor(corners.min(axis=0)).astype(int) - 1, np.ceil(corners.max(axis=0)).astype(int) + 1
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])))
    edges = np.array([corners[1] - corners[0], corners[2] - corners[0]]).T
    weights = np.linalg.solve(edges, np.stack([x + 0.5 - corners[0, 0], y + 0.5 - corners[0, 1]]))
    # The renderer rounds: a centre this near to an edge would be anybody's.
    distance = np.min([weights[0], weights[1], 1 - weights.sum(axis=0)], axis=0) * abs(np.linalg.det(edges))
    assert (np.abs(distance) / np.linalg.norm(corners - np.roll(corners, 1, 0), axis=1).max() > 0.01).all()
    chosen = (weights > 0).all(axis=0) & (weights.sum(axis=0) < 1)
    return set(zip(x[chosen].tolist(), y[chosen].tolist(), strict=True))


@pytest.mark.parametrize("texel, page_side", [(0.3, 64), (0.3, 1024), (3.0, 16), (1000.0, 8)])
def test_texels_belong_to_one_triangle_each(texel: float, page_side: int) -> None:
    corners = triangles(200)
    charts = layout(corners, texel, page_side=page_side)
    owners = np.stack([texel_owners(charts, page) for page in range(charts.page_count)])
    owners = owners.reshape(charts.page_count, charts.page_side, charts.page_side)
    for triangle in range(len(corners)):
        page, y, x = np.nonzero(owners == triangle)
        assert len(x) >= 1 and (page == charts.page[triangle]).all()
        # No overlap: what the triangle covers is what it owns.
        assert inside(charts, triangle) == set(zip(x.tolist(), y.tolist(), strict=True))


def test_pages_are_well_filled_and_bounded() -> None:
    corners = triangles(5000, spread=0.5)[1::2]
    charts = layout(corners, 0.05, page_side=256)
    owned = sum(int((texel_owners(charts, page) >= 0).sum()) for page in range(charts.page_count))
    assert owned > 0.6 * (charts.page_count - 1) * charts.page_side**2
    small = layout(corners, 0.05, max_texels=30_000, page_side=64)
    assert small.texel_world > 0.05
    assert small.texel_count <= 30_000 + 64**2
    single = layout(corners, 0.05, max_texels=1)
    assert (single.kind == SINGLE).all()
    with pytest.raises(SettingError, match="Texel size"):
        layout(corners, 0.0)


def chart_positions(charts: Charts, triangle: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Reference: where on the page (F, 2) points of triangles lie."""
    corners = charts.corner_texels(triangle)
    weights = np.column_stack([1 - barycentric.sum(axis=1), barycentric])
    return np.einsum("fc,fcx->fx", weights, corners)


def test_lookup_is_exact_for_a_linear_function() -> None:
    corners = triangles(400, seed=3)[1::2]
    charts = layout(corners, 0.1, page_side=128)
    plane = np.array([0.3, 0.7, 500.0])  # of the page's x and y, positive everywhere
    side = charts.page_side
    y, x = (axis.ravel() + 0.5 for axis in np.indices((side, side)))
    texels = np.full((charts.page_count, side * side), np.nan, np.float32)
    for page in range(charts.page_count):
        owned = texel_owners(charts, page) >= 0  # what nobody owns is not a number, and must never be touched
        texels[page, owned] = (plane[0] * x + plane[1] * y + plane[2])[owned]
    rng = np.random.default_rng(0)
    triangle = rng.integers(0, len(corners), 20_000)
    barycentric = rng.dirichlet((1, 1, 1), len(triangle))[:, 1:].astype(np.float32)
    values = lookup(charts, texels.reshape(-1, 1), triangle, barycentric)[:, 0]
    assert np.isfinite(values).all()
    position = chart_positions(charts, triangle, barycentric.astype(np.float64))
    expected = position @ plane[:2] + plane[2]
    # Not within half a texel of the legs, nor in their tips, where the values of the nearest texels count.
    start = charts.corner_texels(triangle)[np.arange(len(triangle)), charts.origin[triangle]]
    offset, legs = np.abs(position - start), charts.legs[triangle]
    cell = np.floor(offset - 0.5)
    owned = [((cell + np.array(step) + 0.5) / legs).sum(axis=1) < 1 for step in ((1, 0), (0, 1))]
    clear = (offset >= 0.5).all(axis=1) & owned[0] & owned[1] & (charts.kind[triangle] != SINGLE)
    assert clear.sum() > 3000
    np.testing.assert_allclose(values[clear], expected[clear], rtol=2e-5)
    assert np.abs(values - expected).max() < 16.0 * np.linalg.norm(plane[:2])  # the longest tip, in texels


def test_no_triangle_reads_its_neighbours() -> None:
    corners = triangles(500, seed=5)
    charts = layout(corners, 0.2, page_side=64)
    texels = np.stack([texel_owners(charts, page) for page in range(charts.page_count)]).astype(np.float32)
    rng = np.random.default_rng(1)
    triangle = rng.integers(0, len(corners), 30_000)
    barycentric = rng.dirichlet((0.5, 0.5, 0.5), len(triangle))[:, 1:].astype(np.float32)
    values = lookup(charts, texels.reshape(-1, 1), triangle, barycentric)[:, 0]
    np.testing.assert_allclose(values, triangle, atol=1e-3)
    for page in range(charts.page_count):
        members = np.flatnonzero(charts.page == page)
        np.testing.assert_allclose(triangle_means(charts, texels[page][:, None], members, page)[:, 0], members)
    everyone = np.arange(len(corners))
    np.testing.assert_allclose(triangle_means(charts, texels.reshape(-1, 1), everyone)[:, 0], everyone)


def test_shade_divides_by_opacity() -> None:
    corners = triangles(40, seed=2)[1::2]
    mesh = TriangleMesh.from_arrays(corners, (Material("Pane", alpha=0.25),))
    charts = drain(layout_charts(mesh, 0.2))
    texels = np.zeros((charts.texel_count, 2), np.float32)
    texels[:] = (0.1, 0.25)
    owners = np.concatenate([texel_owners(charts, page) for page in range(charts.page_count)])
    texels[owners % 3 == 0] = (0.0, 0.0)  # there, the renderer saw nothing at all
    shade = atlas_shade(Atlas(charts, texels), mesh)
    count = len(corners)
    fragments = Fragments(np.zeros(count, np.uint64), np.arange(count, dtype=np.int32),
                          np.full((count, 2), 1 / 3, np.float32), np.ones(count))  # fmt: skip
    values, opacity = shade(next(mesh.batches()), fragments)
    assert values.dtype == opacity.dtype == np.float32
    np.testing.assert_allclose(values, 0.4, rtol=1e-5)  # where nothing was seen, as bright as the rest of its material
    np.testing.assert_allclose(opacity, 0.25)
    other = TriangleMesh.from_arrays(corners[:-1])
    with pytest.raises(SettingError, match="bake the light again"):
        atlas_shade(Atlas(charts, texels), other)


def test_gaps_at_the_edge_of_a_cut_out_borrow_from_their_own_triangle() -> None:
    corners = np.array([[[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[9, 0, 0], [13, 0, 0], [9, 4, 0]]], np.float64)
    mesh = TriangleMesh.from_arrays(corners, (Material("Leaf", alpha=0.5),))
    charts = drain(layout_charts(mesh, 0.25))
    owners = np.concatenate([texel_owners(charts, page) for page in range(charts.page_count)])
    texels = np.zeros((charts.texel_count, 2), np.float32)
    texels[owners.ravel() == 0] = (0.1, 0.5)
    texels[owners.ravel() == 1] = (0.3, 0.5)
    texels[::2] = 0.0  # every other texel met a gap
    rng = np.random.default_rng(0)
    triangle = np.sort(rng.integers(0, 2, 500)).astype(np.int32)
    barycentric = rng.dirichlet((1.0, 1.0, 1.0), 500)[:, 1:].astype(np.float32)
    fragments = Fragments(np.zeros(500, np.uint64), triangle, barycentric, np.ones(500))
    luminance, _ = atlas_shade(Atlas(charts, texels), mesh)(next(mesh.batches()), fragments)
    np.testing.assert_allclose(luminance, np.where(triangle == 0, 0.2, 0.6), rtol=1e-4)


GRID = Grid((0.0, 0.0, 0.0), 8.0, 9)


def halves(left: int, right: int) -> LeafLevels:
    """Blocks of level 3, one unit wide; leaves of level `left` where x < 4, of level `right` elsewhere."""
    cells = np.argwhere(np.ones((8, 8, 8), bool))
    levels = np.zeros(512, np.uint8)
    levels[morton_encode(cells).astype(np.int64)] = np.where(cells[:, 0] < 4, left, right)
    return LeafLevels(levels)


def sizes(corners: np.ndarray, layout: LeafLevels) -> np.ndarray:
    return texel_sizes(TriangleMesh.from_arrays(corners), GRID, layout, 2.0)


def small(place: tuple[float, float, float]) -> np.ndarray:
    return np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]) + np.array(place)


def test_small_triangles_have_the_leaves_around_them() -> None:
    result = sizes(np.stack([small((1.2, 3.3, 5.5)), small((6.2, 3.3, 5.5))]), halves(9, 6))
    np.testing.assert_allclose(result, [2 * 8 / 2**9, 2 * 8 / 2**6], rtol=1e-6)


def test_large_triangles_get_as_many_texels_as_their_parts_would() -> None:
    ground = np.array([[[0, 0, 1.0], [8, 0, 1.0], [0, 8, 1.0]], [[8, 8, 1.0], [0, 8, 1.0], [8, 0, 1.0]]])
    result = sizes(ground, halves(7, 4))
    fine, coarse = (2 * 8 / 2**7) ** 2, (2 * 8 / 2**4) ** 2
    # The first triangle has three quarters of its area on the left, the second one quarter.
    for side, left in zip(result, (0.75, 0.25), strict=True):
        wanted = left / fine + (1 - left) / coarse
        assert abs(1 / side**2 / wanted - 1) < 0.08  # some of the points' triangles cross the border


def test_places_without_leaves_and_outside_have_blocks() -> None:
    result = sizes(np.stack([small((1.2, 3.3, 5.5)), small((6.2, 3.3, 5.5)), small((9.0, 3.3, 5.5))]), halves(0, 5))
    np.testing.assert_allclose(result, [2.0, 2 * 8 / 2**5, 2 * 8 / 2**5], rtol=1e-6)
