# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture detail finer than baked texels is restored in voxels."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.atlas_shade import atlas_shade
from patchnet.patchnet_addon.lightmap.charts import layout_charts
from patchnet.patchnet_addon.lightmap.texel_bases import base_of_texels
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments, Material, Texture, TriangleBatch, TriangleMesh

DARK, BRIGHT, LIGHT = 0.2, 0.8, 0.9
BAKED = LIGHT * (DARK + BRIGHT) / 2.0
CORNERS = np.array([[[0.0, 0, 0], [8, 0, 0], [0, 8, 0]]])


def mesh(material: Material) -> TriangleMesh:
    uvs = (CORNERS[..., :2] / 8.0).astype(np.float32)
    return TriangleMesh((TriangleBatch(CORNERS, uvs, np.zeros(1, np.int32), 0),), (material,))


def stripes() -> Texture:
    """Sixteen stripes, each half a unit and four texels wide, dark and bright in turn."""
    column = np.where((np.arange(64) // 4) % 2 == 0, DARK, BRIGHT)
    return Texture("Stripes", np.repeat(np.tile(column, (64, 1))[..., None], 3, axis=-1).astype(np.float32))


def lit(material: Material, xs: np.ndarray, opacity: float = 1.0, *, even: bool = False) -> np.ndarray:
    """Luminance at points (xs, 2) of a surface whose bake has texels of 2 units, two pairs of stripes each.

    Texels hold the same all over, or what even light makes of their own base colours.
    """
    source = mesh(material)
    charts = drain(layout_charts(source, 2.0))
    baked = np.tile(np.array([BAKED * opacity, opacity], np.float32), (charts.texel_count, 1))
    atlas = Atlas(charts, baked, 8)
    if even:
        baked[:, :1] = LIGHT * opacity * base_of_texels(atlas, source)
    barycentric = np.stack([xs / 8.0, np.full_like(xs, 2.0 / 8.0)], axis=-1).astype(np.float32)
    count = len(xs)
    fragments = Fragments(np.zeros(count, np.uint64), np.zeros(count, np.int32), barycentric, np.full(count, 0.02**2))
    luminance, _ = atlas_shade(atlas, source)(next(iter(source.batches())), fragments)
    return luminance


XS = np.array([0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3.25, 3.75])  # centres of stripes


def test_stripes_finer_than_texels_come_back() -> None:
    values = lit(Material("Stripes", (1.0, 1.0, 1.0), stripes()), XS, even=True)
    np.testing.assert_allclose(values[0::2], LIGHT * DARK, rtol=1e-3)
    np.testing.assert_allclose(values[1::2], LIGHT * BRIGHT, rtol=1e-3)


@pytest.mark.parametrize(
    "changed",
    [{"base_texture": None}, {"emission": (1.0, 1.0, 1.0)}, {"alpha": 0.5}],
    ids=["no texture", "emission", "see-through"],
)
def test_what_has_no_detail_of_its_own_keeps_the_baked_light(changed: dict) -> None:
    material = replace(Material("Stripes", (1.0, 1.0, 1.0), stripes()), **changed)
    values = lit(material, XS, material.alpha)
    np.testing.assert_allclose(values, BAKED, rtol=1e-5)


def test_black_and_white_do_not_run_away() -> None:
    """A texture that is nearly black in places has no room for noise to grow in."""
    texture = stripes()
    texture = replace(texture, pixels=np.where(texture.pixels < 0.5, 1e-5, 1.0).astype(np.float32))
    values = lit(Material("Stripes", (1.0, 1.0, 1.0), texture), XS)
    assert values.max() <= 4.0 * BAKED + 1e-6
    assert (values > 0.0).all()
