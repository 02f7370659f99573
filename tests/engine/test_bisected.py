# SPDX-License-Identifier: GPL-3.0-or-later
"""Bisected sources lose the triangles beyond the plane, and no others."""

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.bisected import BisectedSource
from patchnet.patchnet_addon.surface.mesh import MeshSource, TriangleMesh
from patchnet.patchnet_addon.surface.two_lights import two_lights_shade
from patchnet.training.benchmarks.shells import shell_triangles


def octree_of(source: MeshSource) -> Octree:
    grid = Grid.around(source.bounds_world, 6)
    return drain(build_octree(source, grid, two_lights_shade(source), exposure=1.0))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_octree_is_that_of_the_triangles_below_the_plane(axis: int) -> None:
    corners = shell_triangles(1.0, rows=24)
    whole = TriangleMesh.from_arrays(corners)
    low, high = whole.bounds_world[:, axis]
    below = corners.mean(axis=1)[:, axis] <= low + 0.3 * (high - low)
    source = BisectedSource(whole, axis, 0.3)
    assert source.triangle_count == len(corners)
    np.testing.assert_array_equal(source.bounds_world, whole.bounds_world)
    bisected = octree_of(source)
    kept = TriangleMesh.from_arrays(corners[below])
    grid = Grid.around(whole.bounds_world, 6)
    expected = drain(build_octree(kept, grid, two_lights_shade(kept), exposure=1.0))
    np.testing.assert_array_equal(bisected.child_mask, expected.child_mask)
    np.testing.assert_array_equal(bisected.luminance, expected.luminance)


def test_plane_above_all_leaves_nothing_out() -> None:
    whole = TriangleMesh.from_arrays(shell_triangles(1.0, rows=12))
    np.testing.assert_array_equal(octree_of(BisectedSource(whole, 1, 1.0)).child_mask, octree_of(whole).child_mask)
