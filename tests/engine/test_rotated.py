# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotated sources keep areas and shapes."""

import numpy as np

from patchnet.patchnet_addon.octree.voxelize import triangle_areas_and_normals
from patchnet.patchnet_addon.surface.mesh import RotatedSource, TriangleMesh, random_rotation


def test_rotation_is_proper_and_keeps_areas():
    rotation = random_rotation(3)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) > 0
    corners = np.random.default_rng(0).normal(size=(20, 3, 3))
    source = TriangleMesh.from_arrays(corners)
    turned = RotatedSource(source, rotation)
    (batch,) = turned.batches()
    areas, normals = triangle_areas_and_normals(corners)
    turned_areas, turned_normals = triangle_areas_and_normals(batch.corners_world)
    np.testing.assert_allclose(turned_areas, areas)
    np.testing.assert_allclose(turned_normals, normals @ rotation.T, atol=1e-12)
    points = batch.corners_world.reshape(-1, 3)
    np.testing.assert_array_equal(turned.bounds_world, [points.min(axis=0), points.max(axis=0)])
