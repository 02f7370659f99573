# SPDX-License-Identifier: GPL-3.0-or-later
"""Composite light over backgrounds; cube maps."""

import numpy as np
import pytest

from patchnet.patchnet_addon.image.background import BLACK, encoded, opaque, over
from patchnet.patchnet_addon.image.cube_map import FACES, CubeMap, face_camera, pixel_directions
from patchnet.patchnet_addon.image.tone import srgb_encode
from patchnet.patchnet_addon.surface.textures import luminance

LIGHT = np.array([[0.4, 0.2, 0.1], [0.2, 0.1, 0.05], [0.0, 0.0, 0.0]], np.float32)  # weighed by alpha
ALPHA = np.array([1.0, 0.5, 0.0], np.float32)
SKY = np.array([[0.0, 0.0, 1.0], [0.2, 0.4, 0.8], [4.0, 2.0, 1.0]], np.float32)


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
