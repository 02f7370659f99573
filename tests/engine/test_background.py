# SPDX-License-Identifier: GPL-3.0-or-later
"""Backgrounds behind light, and light by direction."""

import numpy as np
import pytest

from patchnet.patchnet_addon.image.background import BLACK, encoded, opaque, over
from patchnet.patchnet_addon.image.cube_map import FACES, CubeMap, face_camera, pixel_directions, view_corners
from patchnet.patchnet_addon.image.tone import srgb_encode
from patchnet.patchnet_addon.surface.textures import luminance
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.engine.octree_samples import random_octree

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


def views() -> list[Camera]:
    place, target = np.array([1.7, -0.9, 1.3]), np.array([0.5, 0.5, 0.5])
    plain = Camera.look_at(place, target, size_px=(7, 5))
    shifted = Camera(
        place, plain.right, plain.up, plain.forward, 0.6, 0.3, 9, 4, shift_x=0.4, shift_y=-0.7, name="Shifted"
    )
    return [plain, shifted, Camera(place, plain.right, plain.up, plain.forward, 1.0, 1.0, 3, 3, kind=ORTHOGRAPHIC)]


@pytest.mark.parametrize("camera", views(), ids=["plain", "shifted", "orthographic"])
def test_directions_of_pixels_are_those_of_rays(camera: Camera) -> None:
    found = pixel_directions(camera)
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    np.testing.assert_allclose(found, first_hits(random_octree(), camera).direction, atol=1e-6)
    assert view_corners(camera).shape == (4, 3)


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
