# SPDX-License-Identifier: GPL-3.0-or-later
"""Textured shading against brute force over the texture; UV coordinates beyond single precision."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.exposure import quantile_exposure
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.surface.mesh import Fragments, Material, Texture, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.surface.shading import albedo_shade, two_lights_shade
from patchnet.patchnet_addon.surface.textures import cut_coverage
from patchnet.tests.references.clip import centroids
from patchnet.tests.references.footprint import bilinear_reference

from .mesh_samples import in_batches, leaves_of, pieces_of, square

WHITE = (1.0, 1.0, 1.0)
REC709 = np.array([0.2126, 0.7152, 0.0722])
SQUARE = square(0.0, 0.0, 1.0)


def painted(material: Material, tiles: float = 1.0) -> TriangleMesh:
    """The unit square in the plane z = 0, its texture repeated `tiles` times along each axis."""
    uvs = (SQUARE[..., :2] * tiles).astype(np.float32)
    return TriangleMesh(in_batches(SQUARE, (), uvs), (material,))


def pieces(mesh: TriangleMesh, depth: int) -> tuple[TriangleBatch, Fragments]:
    """The square cut into 2^depth x 2^depth cells."""
    (batch,) = mesh.batches()
    return batch, pieces_of(batch, Grid((-1e-9, -1e-9, -0.5), 1.0 + 2e-9, depth))


@pytest.mark.parametrize("wrap", ["REPEAT", "EXTEND", "MIRROR", "CLIP"])
@pytest.mark.parametrize("transform", [None, ((0.0, -1.5, 0.25), (2.0, 0.0, -0.5))])
def test_small_fragments_read_the_finest_texels(wrap: str, transform: tuple | None) -> None:
    rng = np.random.default_rng(0)
    pixels = rng.random((5, 7, 3)).astype(np.float32)
    material = Material("M", (0.5, 1.0, 0.25), Texture("T", pixels, wrap, transform))
    mesh = painted(material, tiles=2.5)
    batch, fragments = pieces(mesh, 5)
    fragments = replace(fragments, area_world=fragments.area_world * 1e-6)
    values, opacity, *_ = albedo_shade(mesh)(batch, fragments)
    uv = centroids(batch.corners_world, fragments)[:, :2] * 2.5
    if transform is not None:
        uv = np.column_stack([uv, np.ones(len(uv))]) @ np.array(transform).T
    expected = bilinear_reference(pixels, uv, wrap) @ (REC709 * (0.5, 1.0, 0.25))
    np.testing.assert_allclose(values, expected, atol=1e-5, err_msg="outside of a clipped colour it is black")
    np.testing.assert_allclose(opacity, 1.0, rtol=1e-6)


def test_alpha_fractions_and_cut_alpha() -> None:
    rng = np.random.default_rng(2)
    alpha = np.kron(rng.random((32, 32, 1)), np.ones((8, 8, 1))).astype(np.float32)
    color = np.where(alpha >= 0.5, 0.9, 0.1).astype(np.float32).repeat(3, axis=2)  # what is cut away is dark
    area = float((alpha >= 0.5).mean())
    soft = painted(Material("Soft", WHITE, Texture("C", color), alpha_texture=Texture("A", alpha)))
    hard = painted(Material("Hard", WHITE, Texture("C", color), alpha_texture=Texture("A", alpha), alpha_threshold=0.5))
    for depth in (0 + 1, 3, 5, 9):
        batch, fragments = pieces(soft, depth)
        weight = fragments.area_world
        _, opacity, *_ = albedo_shade(soft)(batch, fragments)
        assert np.average(opacity, weights=weight) == pytest.approx(float(alpha.mean()), abs=0.01)
        values, opacity, *_ = albedo_shade(hard)(batch, fragments)
        assert np.average(opacity, weights=weight) == pytest.approx(area, abs=0.02), "coverage is right at every size"
        assert np.average(values, weights=weight * opacity) == pytest.approx(0.9, abs=0.03), "what is cut has no colour"
    assert (np.minimum(opacity, 1 - opacity) < 1e-6).mean() > 0.8, "most fine fragments are there or not"


def test_constant_alpha_scales_a_texture_and_thresholds_are_of_the_product() -> None:
    alpha = np.linspace(0, 1, 64, dtype=np.float32).reshape(1, 64, 1).repeat(64, axis=0)
    texture = Texture("A", alpha, "EXTEND")
    faint = painted(Material("Faint", alpha=0.5, alpha_texture=texture))
    batch, fragments = pieces(faint, 4)
    _, opacity, *_ = albedo_shade(faint)(batch, fragments)
    assert np.average(opacity, weights=fragments.area_world) == pytest.approx(0.25, abs=0.01)
    cut = painted(Material("Cut", alpha=0.5, alpha_texture=texture, alpha_threshold=0.4))
    _, opacity, *_ = albedo_shade(cut)(batch, fragments)
    assert np.average(opacity, weights=fragments.area_world) == pytest.approx(0.2, abs=0.01)


def test_coverage_of_a_texel() -> None:
    ramp = np.array([[0.0, 0.4, 0.8, 0.8]], np.float32).repeat(3, axis=0)
    # From 0.4 to 0.8 bilinear opacity passes 0.5 at a quarter of the way: a quarter of the texel reaches it.
    np.testing.assert_allclose(cut_coverage(ramp, 0.5, "EXTEND")[1], [0.0, 0.25, 1.0, 1.0])
    opaque = np.ones((3, 3), np.float32)
    clipped = cut_coverage(opaque, 0.7, "CLIP")
    np.testing.assert_allclose(clipped[1], [0.75, 1.0, 0.75], err_msg="nothing is outside")
    np.testing.assert_allclose(cut_coverage(opaque, 0.7, "MIRROR"), 1.0)


def test_colour_and_opacity_laid_out_differently() -> None:
    rng = np.random.default_rng(5)
    base = Texture("C", rng.random((16, 24, 3)).astype(np.float32), "REPEAT", ((4.0, 0.0, 0.1), (0.0, 4.0, 0.0)))
    alpha = Texture("A", rng.random((8, 8, 1)).astype(np.float32), "EXTEND")
    for threshold in (None, 0.5):
        both = painted(Material("Both", WHITE, base, alpha_texture=alpha, alpha_threshold=threshold))
        batch, fragments = pieces(both, 4)
        values, opacity, *_ = albedo_shade(both)(batch, fragments)
        color, *_ = albedo_shade(painted(Material("Colour", WHITE, base)))(batch, fragments)
        cut = painted(Material("Opacity", alpha_texture=alpha, alpha_threshold=threshold))
        np.testing.assert_array_equal(values, color)
        np.testing.assert_array_equal(opacity, albedo_shade(cut)(batch, fragments).opacity)
        assert 0.3 < opacity.mean() < 0.7


def test_two_lights() -> None:
    rng = np.random.default_rng(3)
    corners = rng.normal(size=(50, 3, 3))
    mesh = TriangleMesh.from_arrays(corners, (Material("M", (0.2, 0.4, 0.6), emission=(0.1, 0.1, 0.1)),))
    count = len(corners)
    fragments = Fragments(np.zeros(count, np.uint64), np.arange(count, dtype=np.int32),
                          np.full((count, 2), 1 / 3, np.float32), np.ones(count))  # fmt: skip
    direction = np.array([1.0, -2.0, 0.5])
    values, opacity, *_ = two_lights_shade(mesh, tuple(direction))(next(mesh.batches()), fragments)
    albedo = float(REC709 @ (0.2, 0.4, 0.6))
    for triangle in range(count):
        a, b, c = corners[triangle]
        normal = np.cross(b - a, c - a)
        cosine = abs(normal @ direction) / np.linalg.norm(normal) / np.linalg.norm(direction)
        assert values[triangle] == pytest.approx(albedo * cosine + 0.1, rel=1e-5)
    assert (opacity == 1).all() and values.dtype == np.float32
    turned, *_ = two_lights_shade(mesh, tuple(-direction))(next(mesh.batches()), fragments)
    np.testing.assert_array_equal(turned, values)
    with pytest.raises(SettingError, match="direction"):
        two_lights_shade(mesh, (0.0, 0.0, 0.0))


def test_exposure() -> None:
    values = np.linspace(0.0, 2.0, 100_001)
    assert quantile_exposure(values) == pytest.approx(1.0 / 1.99, rel=1e-4)
    assert quantile_exposure(np.zeros(5)) == 1.0


CORNERS = np.array([[(0.1, 0.1, 0.11), (0.9, 0.1, 0.11), (0.1, 0.9, 0.11)]])
RASTER = np.linspace(0.2, 0.9, 64, dtype=np.float32).reshape(8, 8, 1)


def looked_up(uvs: np.ndarray, wrap: str, threshold: float | None, transform: tuple | None) -> tuple[float, float]:
    """Opaque area of one triangle, and its luminance times that area."""
    base = Texture("base", np.repeat(RASTER, 3, axis=-1), wrap, transform)
    alpha = Texture("alpha", RASTER, wrap, transform)
    material = Material("m", (1.0, 1.0, 1.0), base_texture=base, alpha_texture=alpha, alpha_threshold=threshold)
    mesh = TriangleMesh(in_batches(CORNERS, (), uvs.astype(np.float32)[None]), (material,))
    leaves = leaves_of(mesh, Grid((0.0, 0.0, 0.0), 1.0, 4), albedo_shade(mesh))
    return tuple(float(sum(getattr(part.sums, name).sum() for part in leaves)) for name in ("area", "light"))


@pytest.mark.parametrize(
    ("wrap", "threshold", "value"),
    [*itertools.product(("REPEAT", "EXTEND", "MIRROR", "CLIP"), (None, 0.5), (1e6, 1e19, -1e19, 1e38, np.inf, np.nan))],
)
def test_lookups_end_and_are_finite(wrap: str, threshold: float | None, value: float) -> None:
    everywhere, one_corner, across = np.full((3, 2), value), np.zeros((3, 2)), np.array([(-1, 1), (1, -1), (1, 1)])
    one_corner[1] = value
    for uvs in (everywhere, one_corner, across * value):
        area, luminance = looked_up(uvs, wrap, threshold, None)
        assert 0.0 <= area <= 0.32 + 1e-6 and 0.0 <= luminance <= 0.32
        scaled = looked_up(uvs, wrap, threshold, ((1e30, 0.0, 0.0), (0.0, 1e30, 0.5)))
        assert np.isfinite(scaled).all()


@pytest.mark.parametrize("value", [3e7, 1e19, 1e38])
def test_far_coordinates_are_whole_numbers(value: float) -> None:
    """As in single precision, in which a renderer counts texels."""
    for wrap, same in (("REPEAT", 0.0), ("MIRROR", 0.0), ("EXTEND", 5.0), ("CLIP", 5.0)):
        found = looked_up(np.full((3, 2), value), wrap, None, None)
        assert found == pytest.approx(looked_up(np.full((3, 2), same), wrap, None, None), rel=1e-5)
