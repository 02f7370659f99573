# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfels as triangles: within the surface's triangles, and facing as these do, however thin they are."""

import bpy
import numpy as np
import pytest

from patchnet.patchnet_addon.light.surfel_triangles import _weights
from patchnet.patchnet_addon.light.surfels import SURFEL
from patchnet.tests.blender.job_scene import build
from patchnet.tests.blender.light_scene import lit
from patchnet.tests.blender.shaders import world


@pytest.mark.parametrize("width", [1.0, 0.1, 1e-2, 1e-3])
def test_surfels_lie_within_their_triangles_and_face_as_they_do(width: float) -> None:
    rng = np.random.default_rng(1)
    count = 5000
    corners = rng.normal(size=(count, 3, 3))
    corners[:, 2] = corners[:, 0] + rng.uniform(size=(count, 1)) * (corners[:, 1] - corners[:, 0])
    corners[:, 2] += width * rng.normal(size=(count, 3))
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    surfels = np.zeros(count, SURFEL)
    middle = rng.dirichlet((1.0, 1.0, 1.0), count)
    surfels["one"], surfels["two"] = middle[:, 1], middle[:, 2]
    surfels["area"] = area * rng.uniform(1e-4, 1.0, count)
    weights = _weights(corners, surfels)
    np.testing.assert_allclose(weights.sum(axis=2), 1.0, atol=1e-9)
    assert weights.min() > 0.0
    share = np.linalg.det(weights) * area / surfels["area"]
    assert share.min() > 0.0 and share.max() < 1.0 + 1e-5 and np.median(share) > 0.02 * width


@pytest.mark.usefixtures("registered")
def test_thin_boxes_in_even_light_are_even() -> None:
    """Laths, whose sides are long triangles, before a white world and nothing else."""
    build(light=False)
    bpy.data.batch_remove([item for item in bpy.data.objects if item.type == "MESH" and item.name != "Lath 0"])
    world().nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    octree = lit(depth=6, max_samples=2, size=(64, 64), exposure=1.0, gloss="off", sides="one").octree
    values = octree.luminance_float(octree.level(octree.depth))
    assert values.min() > 0.8 and np.ptp(values) < 0.02
