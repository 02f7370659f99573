# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks and patches against a dense grid in which every node's cube was marked."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.patches import OCTANTS, corner_neighbours, covering_nodes, voxel_blocks
from patchnet.tests.engine.octree_samples import around_voxels, dense_cells, random_octree, with_boxes
from patchnet.tests.references.lookups import covering_nodes_reference


@pytest.fixture(params=[False, True], ids=["uniform", "adaptive, with boxes"])
def octree(request):
    octree = random_octree(seed=3, depth=5, count=400, adaptive=request.param)
    return with_boxes(octree) if request.param else octree


def test_missing_node_has_an_empty_block(octree):
    assert not voxel_blocks(octree, np.array([-1])).any()


def test_covering_nodes(octree):
    axis = np.arange(-1, 9)
    cells = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    nodes = covering_nodes(octree, 3, cells)
    np.testing.assert_array_equal(nodes, covering_nodes_reference(octree, 3, cells))
    occupied = np.pad(dense_cells(octree, 3)[..., 0], 1)
    x, y, z = (cells + 1).T
    np.testing.assert_array_equal(nodes >= 0, occupied[z, y, x] > 0)


def test_neighbours_of_a_corner_meet_there(octree):
    level = 4
    nodes = np.arange(octree.level_start[level], octree.level_start[level + 1])
    for octant, offset in enumerate(OCTANTS):  # seen from there, a voxel is the neighbour in the opposite octant
        neighbours = corner_neighbours(octree, level, octree.cells(level) + offset)
        np.testing.assert_array_equal(neighbours[:, 7 - octant], nodes)


@pytest.mark.parametrize("adaptive", [False, True])
def test_nodes_around_voxels(adaptive: bool) -> None:
    """Of all voxels of all levels, at the edges of the root cube too, and around such as are empty."""
    octree = random_octree(seed=3, depth=5, count=700, adaptive=adaptive)
    random = np.random.default_rng(2)
    offsets = np.array([[block % 3 - 1, block // 3 % 3 - 1, block // 9 - 1] for block in range(27)])
    for level in range(octree.depth + 1):
        cells = np.concatenate([octree.cells(level), random.integers(0, 1 << level, (200, 3))])
        voxels = np.column_stack([np.full(len(cells), level), cells])
        near = (cells[:, None].astype(np.int64) + offsets).reshape(-1, 3)
        inside = ((near >= 0) & (near < 1 << level)).all(axis=1)
        wanted = np.where(inside, covering_nodes_reference(octree, level, np.where(inside[:, None], near, 0)), -1)
        np.testing.assert_array_equal(around_voxels(octree, voxels), wanted.reshape(-1, 27))
