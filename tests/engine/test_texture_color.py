# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour of shaded fragments against its reference; luminance and opacity keep their bits."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.surface.mesh import Fragments, Material, Texture, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.surface.shading import albedo_shade, two_lights_shade
from patchnet.patchnet_addon.surface.texture_lookup import color_of_fragments
from patchnet.patchnet_addon.surface.textures import REC709, TextureTable
from patchnet.tests.engine.mesh_samples import in_batches, pieces_of
from patchnet.tests.references.texture_color import colors_reference

WHITE = (1.0, 1.0, 1.0)


def materials() -> tuple[Material, ...]:
    rng = np.random.default_rng(0)
    image = rng.random((20, 30, 3)).astype(np.float32) ** 2
    color = Texture("color", image)
    turned = Texture("turned", image, "MIRROR", ((0.0, -1.5, 0.25), (2.0, 0.0, -0.5)))
    alpha = Texture("alpha", (np.kron(rng.random((8, 8)), np.ones((5, 5))) > 0.4).astype(np.float32)[..., None])
    return (
        Material("wall", (0.5, 1.0, 0.25), color),
        Material("clipped", WHITE, replace(color, wrap="CLIP")),
        Material("cut", WHITE, color, alpha_texture=alpha, alpha_threshold=0.5),
        Material("soft", (0.9, 0.2, 0.1), alpha_texture=alpha),
        Material("two mappings", WHITE, turned, alpha_texture=alpha, alpha_threshold=0.5),
        Material("plain", (0.1, 0.8, 0.3), emission=(2.0, 0.0, 1.0)),
        Material("black", (0.0, 0.0, 0.0)),
    )


@pytest.fixture(scope="module")
def mesh() -> TriangleMesh:
    rng = np.random.default_rng(1)
    corners = rng.random((140, 1, 3)) + rng.normal(size=(140, 3, 3)) * rng.uniform(0.02, 0.3, (140, 1, 1))
    uvs = rng.uniform(-1, 2, (140, 3, 2)).astype(np.float32)
    ids = (np.arange(140) % len(materials())).astype(np.int32)
    return TriangleMesh(in_batches(corners, (), uvs, ids), materials())


@pytest.fixture(scope="module", params=[3, 6])
def pieces(mesh: TriangleMesh, request: pytest.FixtureRequest) -> tuple[TriangleBatch, Fragments]:
    (batch,) = mesh.parts
    found = pieces_of(batch, Grid.around(mesh.bounds_world, request.param))
    return batch, found.only(np.arange(0, min(len(found), 6000), 4))


def test_kernel_equals_reference(mesh: TriangleMesh, pieces: tuple[TriangleBatch, Fragments]) -> None:
    table = TextureTable.from_materials(mesh.materials, color=True)
    luminance = np.random.default_rng(2).random(len(pieces[1])).astype(np.float32)
    found = color_of_fragments(table, *pieces, luminance)
    np.testing.assert_allclose(found, colors_reference(table, *pieces, luminance), rtol=1e-3, atol=2e-4)
    lit = found.sum(axis=1) > 0
    np.testing.assert_allclose(found[lit] @ REC709, luminance[lit], rtol=1e-4)


@pytest.mark.parametrize("make", [albedo_shade, two_lights_shade])
def test_shades_have_colour_only_when_asked(make, mesh: TriangleMesh, pieces) -> None:
    luminance, opacity, none, *_ = make(mesh)(*pieces)
    same, as_before, color, *_ = make(mesh, color=True)(*pieces)
    assert len(none) == 0
    np.testing.assert_array_equal(same, luminance)
    np.testing.assert_array_equal(as_before, opacity)
    seen = opacity > 0.01
    np.testing.assert_allclose((color @ REC709)[seen], luminance[seen], rtol=1e-3, atol=1e-6)
    for name, hue in (("soft", (0.9, 0.2, 0.1)), ("black", WHITE)):
        own = np.array([m.name for m in mesh.materials])[pieces[0].materials[pieces[1].triangle]] == name
        expected = np.array(hue) / (REC709 @ hue) * luminance[own][:, None]
        np.testing.assert_allclose(color[own], expected, rtol=1e-3, atol=1e-6)


def test_large_fragments_show_the_mean_colour() -> None:
    """A checkerboard of red and blue from afar is magenta."""
    board = np.zeros((64, 64, 3), np.float32)
    board[..., 0] = np.indices((64, 64)).sum(axis=0) % 2
    board[..., 2] = 1.0 - board[..., 0]
    corners = np.array([[(0, 0, 0), (1, 0, 0), (1, 1, 0)]], float)
    uvs = corners[..., :2].astype(np.float32)
    mesh = TriangleMesh(in_batches(corners, (), uvs), (Material("M", WHITE, Texture("T", board)),))
    whole = Fragments(
        np.zeros(1, np.uint64), np.zeros(1, np.int32), np.full((1, 2), 1 / 3, np.float32), np.array([0.5])
    )
    luminance, _, color, *_ = albedo_shade(mesh, color=True)(mesh.parts[0], whole)
    np.testing.assert_allclose(color[0], (0.5, 0.0, 0.5), atol=1e-3)
    assert luminance[0] == pytest.approx((0.2126 + 0.0722) / 2, rel=1e-3)
