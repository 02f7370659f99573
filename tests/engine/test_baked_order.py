# SPDX-License-Identifier: GPL-3.0-or-later
"""Octrees with baked light have the same bits for any order of triangles and any blocks."""

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.atlas_shade import atlas_shade, irradiance_of_materials
from patchnet.patchnet_addon.lightmap.chart_lookup import texel_owners
from patchnet.patchnet_addon.lightmap.charts import layout_charts
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import LeafSums
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleMesh
from patchnet.patchnet_addon.surface.textures import TextureTable

from .mesh_samples import in_batches, leaves_of

COUNT = 600


def materials() -> tuple[Material, ...]:
    """Two cut-outs, a pane and a wall."""
    rng = np.random.default_rng(1)
    alpha = Texture("alpha", (np.kron(rng.random((8, 8)), np.ones((4, 4))) > 0.5).astype(np.float32)[..., None])
    haze = Texture("haze", rng.uniform(0.3, 1.0, (9, 9, 1)).astype(np.float32))
    color = Texture("color", rng.random((20, 30, 3)).astype(np.float32))
    white = (1.0, 1.0, 1.0)
    return (
        Material("cut", white, color, alpha_texture=alpha, alpha_threshold=0.5),
        Material("soft", (0.2, 0.5, 0.1), alpha_texture=haze),
        Material("pane", alpha=0.25),
        Material("wall", white, color),
    )


def shuffled(order: np.ndarray, parts: int) -> tuple[TriangleMesh, np.ndarray]:
    """The same triangles in another order and other batches; and what the bake saw of each, (T, 2)."""
    rng = np.random.default_rng(2)
    corners = rng.random((COUNT, 1, 3)) + rng.normal(size=(COUNT, 3, 3)) * rng.uniform(0.01, 0.1, (COUNT, 1, 1))
    uvs = rng.uniform(0, 3, (COUNT, 3, 2)).astype(np.float32)
    ids = rng.integers(0, 4, COUNT).astype(np.int32)
    seen = rng.uniform(0.1, 1.0, (COUNT, 2)).astype(np.float32)
    seen[rng.random(COUNT) < 0.4] = 0.0  # the bake met gaps only
    cuts = np.linspace(0, COUNT, parts + 1).astype(int)[1:-1]
    return TriangleMesh(in_batches(corners[order], cuts, uvs[order], ids[order]), materials()), seen[order]


def baked(mesh: TriangleMesh, seen: np.ndarray) -> Atlas:
    """All texels of a triangle hold the same, light and base colour: where they lie depends on the order."""
    charts = drain(layout_charts(mesh, 0.01))
    owners = np.concatenate([texel_owners(charts, page) for page in range(charts.page_count)]).ravel()
    texels = np.where(owners[:, None] >= 0, seen[owners], 0.0).astype(np.float32)
    return Atlas(charts, texels, base=0.2 + 0.5 * texels[:, :1])


def leaves(order: np.ndarray, parts: int, block_fragments: int, colored: bool) -> LeafSums:
    mesh, seen = shuffled(order, parts)
    atlas = baked(mesh, seen)
    if colored:
        hue = np.stack([0.5 * atlas.texels[:, 0], 2.0 * atlas.texels[:, 0] * atlas.texels[:, 1]], axis=-1)
        texels, base = np.concatenate([atlas.texels, hue], axis=1), np.repeat(atlas.base, 3, axis=1)
        atlas = Atlas(atlas.charts, texels, base=base)
    shade = atlas_shade(atlas, mesh)
    (leaves,) = leaves_of(mesh, Grid.around(mesh.bounds_world, 6), shade, block_fragments=block_fragments)
    return leaves


@pytest.mark.parametrize("colored", [False, True])
@pytest.mark.parametrize("parts, block_fragments", [(1, 10**9), (3, 2_000), (7, 300)])
def test_bits_do_not_depend_on_order_batches_or_blocks(parts: int, block_fragments: int, colored: bool) -> None:
    expected = leaves(np.arange(COUNT), 1, 10**9, colored)
    found = leaves(np.random.default_rng(parts).permutation(COUNT), parts, block_fragments, colored)
    np.testing.assert_array_equal(found.keys, expected.keys)
    np.testing.assert_array_equal(found.sums, expected.sums)


def test_colour_changes_no_luminance() -> None:
    gray, colored = (leaves(np.arange(COUNT), 1, 10**9, colored) for colored in (False, True))
    np.testing.assert_array_equal(colored.sums[:, :5], gray.sums)
    assert colored.sums.shape[1] == 7 and (colored.sums[:, 5] != colored.sums[:, 6]).any()


def test_lost_triangles_take_the_light_of_their_material() -> None:
    """Against a direct sum over all triangles that the bake saw."""
    mesh, seen = shuffled(np.arange(COUNT), 1)
    (batch,) = mesh.parts
    atlas = baked(mesh, seen)
    table = TextureTable.from_materials(mesh.materials)
    found = irradiance_of_materials(atlas.charts, atlas.texels, table, mesh, 1e-3)
    edges = batch.corners_world[:, 1:] - batch.corners_world[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    for material, albedo in ((1, np.array((0.2, 0.5, 0.1)) @ (0.2126, 0.7152, 0.0722)), (2, 0.8)):
        own = batch.materials == material
        light, color = (area[own] * seen[own, 0]).sum(), (area[own] * seen[own, 1]).sum() * albedo
        assert found[material] == pytest.approx(light / color, rel=1e-5)
