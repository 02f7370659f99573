# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer rays hit the same voxels as rays of a finer picture."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.chosen import fine_rays
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.patchnet_addon.tracing.supersample import behind_patches
from patchnet.tests.engine.octree_samples import random_octree, with_boxes
from patchnet.tests.references.first_hits import hits_of_pixels, shown_by

PERSPECTIVE = Camera.look_at(np.array([2.1, 1.4, 1.2]), np.full(3, 0.5), size_px=(45, 30))
CAMERAS = {
    "perspective": PERSPECTIVE,
    "inside": Camera.look_at(np.array([0.52, 0.49, 0.51]), np.array([0.9, 0.6, 0.4]), size_px=(33, 17)),
    "orthographic": replace(PERSPECTIVE, kind=ORTHOGRAPHIC, half_x=0.8, half_y=0.6),
    "one pixel": PERSPECTIVE.with_size(1, 1),
}


@pytest.fixture(scope="module", params=[False, True], ids=["whole voxels", "boxes"])
def octree(request):
    found = random_octree(depth=7, count=400)
    return with_boxes(found) if request.param else found


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_they_meet_the_same_voxels(name, lookahead, octree):
    """Bit for bit, as rays of a picture that is twice as large."""
    camera = CAMERAS[name]
    rays = fine_rays(octree, camera, lookahead=lookahead)
    double = camera.with_size(2 * camera.width_px, 2 * camera.height_px)
    nodes, _ = hits_of_pixels(octree, double, 2.0**lookahead)
    quarters = (
        shown_by(octree, nodes).reshape(camera.height_px, 2, camera.width_px, 2).transpose(0, 2, 1, 3).reshape(-1, 4)
    )
    np.testing.assert_array_equal(rays, quarters)
    assert rays.shape == (camera.pixel_count, 4) and rays.dtype == np.float32


def test_something_is_met(octree):
    camera = CAMERAS["perspective"]
    assert behind_patches(octree, camera, first_hits(octree, camera)).coverage.any()
    assert fine_rays(octree, camera).any()
