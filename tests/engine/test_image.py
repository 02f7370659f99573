# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour maps against published tables, the sRGB curve, heatmaps, overlays, light over backgrounds, cube maps."""

import numpy as np
import pytest

from patchnet.patchnet_addon.image.background import BLACK, encoded, opaque, over
from patchnet.patchnet_addon.image.colormaps import COLORMAPS, colormap
from patchnet.patchnet_addon.image.cube_map import FACES, CubeMap, face_camera, pixel_directions
from patchnet.patchnet_addon.image.heatmap import heatmap, magnify, overlay
from patchnet.patchnet_addon.image.tone import srgb_encode, to_bytes
from patchnet.patchnet_addon.surface.textures import luminance

LIGHT = np.array([[0.4, 0.2, 0.1], [0.2, 0.1, 0.05], [0.0, 0.0, 0.0]], np.float32)  # weighed by alpha
ALPHA = np.array([1.0, 0.5, 0.0], np.float32)
SKY = np.array([[0.0, 0.0, 1.0], [0.2, 0.4, 0.8], [4.0, 2.0, 1.0]], np.float32)


@pytest.mark.parametrize("name", COLORMAPS)
def test_colormap_against_matplotlib(name: str) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    values = np.linspace(0, 1, 256)
    np.testing.assert_allclose(colormap(values, name), matplotlib.colormaps[name](values)[:, :3], atol=1 / 255)


def test_colormap_outside_its_range() -> None:
    np.testing.assert_array_equal(colormap(np.array([-1.0, np.nan, 7.0])), colormap(np.array([0.0, 0.0, 1.0])))


def test_srgb_anchors() -> None:
    # 18 % gray is byte 118; 0.0031308 is where the two pieces meet.
    assert to_bytes(srgb_encode(np.array([0.0, 0.18, 1.0, 5.0, np.nan]))).tolist() == [0, 118, 255, 255, 0]
    around = srgb_encode(np.array([0.0031307, 0.0031309]))
    assert abs(around[1] - around[0]) < 1e-4


def test_heatmap_uses_the_configured_maximum() -> None:
    priority = np.linspace(0, 0.2, 130 * 130, dtype=np.float32).reshape(130, 130)
    page = heatmap(priority, 0.5, "expected luminance error")
    assert page.shape[1] == 520 and page.dtype == np.float32
    # 0.2 of 0.5: never brighter than 40 % of the map, outside of the legend.
    foot = page.shape[0] - 520 - 26
    view = page[foot : foot + 520]
    np.testing.assert_allclose(view[0, 0], colormap(np.array(0.0)), atol=1e-6)
    np.testing.assert_allclose(view[-1, -1], colormap(np.array(0.4)), atol=1e-6)
    assert page.min() >= 0.0 and page.max() <= 1.0
    assert heatmap(priority[:, :4], 0.5, "expected luminance error").shape[1] == 16, "too narrow for a legend"


def test_overlay_leaves_other_pixels_gray() -> None:
    gray = np.full((64, 64), 0.3, np.float32)
    urgency = np.zeros((64, 64), np.float32)
    urgency[10, 20], urgency[30, 20] = 1.0, 0.1
    page = overlay(gray, urgency, "a budget of 30%")
    factor = magnify(gray).shape[0] // 64
    foot = next(row for row in range(page.shape[0]) if np.allclose(page[row, 0], srgb_encode(np.float32(0.3))))
    view = page[foot : foot + 64 * factor : factor, : 64 * factor : factor]
    np.testing.assert_allclose(view[0, 0], srgb_encode(np.float32(0.3)), atol=1e-6)
    redness = view[..., 0] - view[..., 1]
    assert redness[10, 20] > redness[30, 20] > redness[0, 0] == 0.0


def test_light_lies_over_an_exposed_background() -> None:
    found = over(LIGHT, ALPHA, SKY, 0.5)
    np.testing.assert_allclose(found, [LIGHT[0], LIGHT[1] + 0.25 * SKY[1], 0.5 * SKY[2]], rtol=1e-6)
    gray = over(luminance(LIGHT), ALPHA, SKY, 0.5)
    np.testing.assert_allclose(gray, luminance(found), rtol=1e-5)
    np.testing.assert_array_equal(over(LIGHT, ALPHA, BLACK, 3.0), LIGHT)


def test_pictures_are_clamped_behind_objects_too() -> None:
    found = encoded(LIGHT, ALPHA, SKY, 1.0)
    assert found.shape == (3, 3) and found[2] == pytest.approx(1.0) and found.max() <= 1.0
    np.testing.assert_array_equal(found[0], srgb_encode(LIGHT[0]))


def test_without_a_background_alpha_is_straight() -> None:
    found = encoded(LIGHT, ALPHA, None, 1.0)
    np.testing.assert_allclose(found[:, 3], ALPHA)
    np.testing.assert_allclose(found[1, :3], srgb_encode(2.0 * LIGHT[1]), rtol=1e-6)
    assert not found[2].any()
    assert encoded(LIGHT[:, 0], ALPHA, None, 1.0).shape == (3, 4)
    np.testing.assert_allclose(opaque(found)[1], srgb_encode(2.0 * LIGHT[1]) * 0.5, rtol=1e-6)
    assert encoded(LIGHT[:0], ALPHA[:0], None, 1.0).shape == (0, 4)


@pytest.mark.parametrize("side", [1, 2, 33])
def test_a_cube_map_is_looked_up_on_all_faces(side: int) -> None:
    """Texels hold their own directions on the cube, which are linear on a face and so found between texels exactly."""
    faces = np.stack([pixel_directions(face_camera(face, side)).reshape(side, side, 3) for face in range(6)])
    known = CubeMap(faces.astype(np.float16))
    directions = np.random.default_rng(3).normal(size=(400, 3))
    on_cube = directions / np.abs(directions).max(axis=1, keepdims=True)
    inside = 1.0 - 1.0 / side  # beyond the outermost texels' centres the nearest counts
    np.testing.assert_allclose(known.look(directions), np.where(
        np.abs(on_cube) == 1.0, on_cube, on_cube.clip(-inside, inside)), atol=2e-3)  # fmt: skip
    for _, _, forward in FACES:
        np.testing.assert_array_equal(known.look(2.0 * forward[None]).round(2), forward[None])
    assert known.look(np.empty((0, 3))).shape == (0, 3)
