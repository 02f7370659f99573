# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colours of texels against their reference."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.chart_lookup import texel_owners
from patchnet.patchnet_addon.lightmap.charts import layout_charts
from patchnet.patchnet_addon.lightmap.packing import FIRST, SECOND, SINGLE
from patchnet.patchnet_addon.lightmap.texel_bases import BatchTexels, base_colors, texel_centres
from patchnet.patchnet_addon.octree.voxelize import triangle_areas_and_normals
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.surface.textures import TextureTable
from patchnet.tests.references.light_map import base_colors_reference, texel_places_reference

MATERIALS = 5


def surface() -> TriangleMesh:
    """Triangles of all sizes and five materials: plain, black, a texture, and that cut out by another, in two ways."""
    rng = np.random.default_rng(5)
    corners = rng.uniform(0.0, 20.0, (60, 1, 3)) + rng.normal(size=(60, 3, 3)) * rng.choice([0.2, 3.0], (60, 1, 1))
    uvs = rng.uniform(-1.0, 2.0, (60, 3, 2)).astype(np.float32)
    image = Texture("image", rng.random((40, 30, 3)).astype(np.float32))
    holes = Texture("holes", (rng.random((16, 16, 1)) > 0.5).astype(np.float32))
    shifted = replace(holes, transform=((1.0, 0.3, 0.1), (-0.3, 1.0, 0.2)))
    materials = (
        Material("plain", (0.25, 0.5, 0.75)),
        Material("black", (0.0, 0.0, 0.0)),
        Material("image", (1.0, 0.5, 1.0), image),
        Material("cut", (0.9, 0.1, 0.4), image, alpha_texture=holes, alpha_threshold=0.5),
        Material("apart", (0.9, 0.1, 0.4), image, alpha=0.6, alpha_texture=shifted),
    )
    batch = TriangleBatch(corners, uvs, (np.arange(60) % MATERIALS).astype(np.int32), 0)
    return TriangleMesh((batch,), materials)


def own_texels(source: TriangleMesh) -> BatchTexels:
    """All texels of the surface; its charts are of all kinds and lie on several pages."""
    charts = drain(layout_charts(source, 0.5, page_side=16))
    assert charts.page_count > 2 and {FIRST, SECOND, SINGLE} <= set(charts.kind.tolist())
    owners = np.concatenate([texel_owners(charts, page) for page in range(charts.page_count)])
    index = np.flatnonzero(owners >= 0)
    corners = charts.corner_texels(np.arange(source.triangle_count))
    return BatchTexels(index, owners[index].astype(np.int64), corners, charts.page_side)


def test_kernel_and_reference_agree() -> None:
    own = own_texels(surface())
    found = texel_centres(own)
    np.testing.assert_allclose(found, texel_places_reference(own)[:, 0], atol=1e-6)
    assert (found >= 0.0).all() and (found.sum(axis=1) < 1.0 + 1e-6).all()


@pytest.mark.parametrize("spread", [0.5, 1.0])
@pytest.mark.parametrize("colored", [False, True])
def test_base_colors_are_those_of_the_reference(spread: float, colored: bool) -> None:
    """Place by place, weighed by opacity, and the same bits whatever texels are asked for together."""
    source, own = surface(), own_texels(surface())
    (batch,) = source.parts
    table = TextureTable.from_materials(source.materials, color=colored)
    assert (table.materials.color_chain >= 0).any()
    area = triangle_areas_and_normals(batch.corners_world)[0][own.triangles] / 7.0
    found = base_colors(table, batch, own, area, spread=spread, colored=colored)
    expected = base_colors_reference(table, batch, own, area, spread=spread, colored=colored)
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=2e-5)
    few = np.arange(3, len(own), 7)
    chosen = replace(own, texels=own.texels[few], triangles=own.triangles[few])
    again = base_colors(table, batch, chosen, area[few], spread=spread, colored=colored)
    np.testing.assert_array_equal(again, found[few])


def test_plain_materials_keep_their_color() -> None:
    source, own = surface(), own_texels(surface())
    (batch,) = source.parts
    table = TextureTable.from_materials(source.materials, color=True)
    found = base_colors(table, batch, own, np.ones(len(own)), spread=1.0, colored=True)
    materials = batch.materials[own.triangles]
    luminance = 0.2126 * 0.25 + 0.7152 * 0.5 + 0.0722 * 0.75
    np.testing.assert_allclose(
        found[materials == 0], np.array([[luminance, 0.25, 0.75]] * (materials == 0).sum()), rtol=1e-3
    )
    assert (materials == 1).any() and not found[materials == 1].any()
