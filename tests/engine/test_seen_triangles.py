# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that a camera sees, against every ray with every triangle."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.seen_triangles import Sight
from patchnet.tests.references.triangle_hits import seen_triangles_reference


def looking(seed: int) -> list[Camera]:
    """Cameras outside, among the triangles, shifted and clipped, and orthographic."""
    rng = np.random.default_rng(seed)
    outside = Camera.look_at(np.array([3.0, -4.0, 2.0]), np.full(3, 0.5), fov=0.3, size_px=(96, 54))
    among = Camera.look_at(rng.random(3), rng.random(3) + 1.0, fov=1.4, size_px=(72, 96))
    clipped = replace(outside, shift_x=0.3, shift_y=-0.2, clip_start=4.3, clip_end=5.2)
    flat = replace(outside, kind=ORTHOGRAPHIC, half_x=1.2, half_y=0.7, shift_x=-0.1)
    return [outside, among, clipped, flat]


@pytest.mark.parametrize("seed", range(3))
def test_as_every_ray_against_every_triangle(seed: int) -> None:
    corners = np.random.default_rng(seed).random((60, 1, 3)) + np.random.default_rng(seed + 9).normal(
        0, 0.2, (60, 3, 3)
    )
    for camera in looking(seed):
        sight = Sight(camera)
        sight.add(corners[:25], np.ones(25, bool), 0)
        sight.add(corners[25:], np.ones(35, bool), 25)
        seen, wanted = sight.seen, seen_triangles_reference(camera, corners)
        differ = seen.triangle != wanted.triangle
        assert differ.mean() < 1e-4  # a pixel's centre may lie on an edge, to the last bit
        met = (seen.triangle >= 0) & ~differ
        assert met.mean() > 0.03
        np.testing.assert_allclose(seen.depth[met], wanted.depth[met], rtol=1e-9)


def test_what_is_not_shown_hides_nothing() -> None:
    near = np.array([[[-9.0, 0.0, -9.0], [9.0, 0.0, -9.0], [0.0, 0.0, 9.0]]])
    camera = Camera.look_at(np.array([0.0, -2.0, 0.0]), np.zeros(3), size_px=(4, 3))
    sight = Sight(camera)
    sight.add(np.concatenate([near, near + [0.0, 1.0, 0.0]]), np.array([False, True]), 7)
    assert (sight.seen.triangle == 8).all()
    sight.add(near[:, ::-1], np.ones(1, bool), 20)
    assert (sight.seen.triangle == 20).all()
