# SPDX-License-Identifier: GPL-3.0-or-later
"""Bisected surfaces lose everything beyond the plane, to the accuracy of a voxel, and nothing else."""

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.surface.shading import bisected_shade, two_lights_shade
from patchnet.training.benchmarks.shells import shell_triangles

DEPTH = 6


def octrees(axis: int, share: float) -> tuple[Octree, Octree]:
    """A sphere of large triangles, cut open and whole."""
    mesh = TriangleMesh.from_arrays(shell_triangles(1.0, rows=6))
    grid, shade = Grid.around(mesh.bounds_world, DEPTH), two_lights_shade(mesh)
    bisected = bisected_shade(shade, mesh.bounds_world, axis, share)
    return drain(build_octree(mesh, grid, bisected, exposure=1.0)), drain(build_octree(mesh, grid, shade, exposure=1.0))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_leaves_below_the_plane_stay_as_they_are(axis: int) -> None:
    cut, whole = octrees(axis, 0.3)
    cells, whole_cells = cut.cells(DEPTH), whole.cells(DEPTH)
    bounds = TriangleMesh.from_arrays(shell_triangles(1.0, rows=6)).bounds_world[:, axis]
    plane = (bounds[0] + 0.3 * (bounds[1] - bounds[0]) - cut.grid.origin_world[axis]) / cut.grid.voxel_size_world
    assert cells[:, axis].max() <= plane
    expected = whole_cells[whole_cells[:, axis] + 1 <= plane]
    assert len(expected) <= len(cells) < len(expected) + 200
    nodes, whole_nodes = cut.find(DEPTH, expected), whole.find(DEPTH, expected)
    assert nodes.min() >= 0
    np.testing.assert_array_equal(cut.area_world[nodes], whole.area_world[whole_nodes])
    np.testing.assert_array_equal(cut.luminance[nodes], whole.luminance[whole_nodes])


def test_plane_above_all_leaves_nothing_out() -> None:
    cut, whole = octrees(1, 1.0)
    np.testing.assert_array_equal(cut.child_mask, whole.child_mask)
