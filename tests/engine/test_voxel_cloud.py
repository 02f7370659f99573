# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxels of one level against a dense grid."""

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.cells.morton_kernels import cell_coordinate, cell_key
from patchnet.patchnet_addon.octree.voxel_cloud import level_within, voxel_cloud, voxel_counts, voxel_runs
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.tests.engine.octree_samples import dense_cells, plain_key, random_octree
from patchnet.tests.references.lookups import node_at

LEVELS = range(6)


@pytest.fixture(scope="module", params=[False, True], ids=["uniform", "adaptive"])
def octree(request):
    return random_octree(seed=3, depth=5, count=400, adaptive=request.param)


def marked(octree, level):
    """Dense grid, order z, y, x, as `dense_cells`, from the voxels of the cloud."""
    cloud, side = voxel_cloud(octree, level), 1 << level
    grid = np.zeros((side, side, side, 5), np.float32)
    low = octree.grid.to_unit(cloud.centres_world - cloud.side_world[:, None] / 2) * side
    width = cloud.side_world / octree.grid.side_world * side
    for (x, y, z), w, *values in zip(
        np.rint(low).astype(int), np.rint(width).astype(int), cloud.luminance, cloud.normal, strict=True
    ):
        block = grid[z : z + w, y : y + w, x : x + w]
        assert not block.any(), "two voxels in one place"
        block[:] = [1, values[0], *values[1]]
    return grid


@pytest.mark.parametrize("level", LEVELS)
def test_voxels_fill_the_cells_of_the_level(octree, level):
    np.testing.assert_allclose(marked(octree, level), dense_cells(octree, level), atol=1e-6)


def test_counts(octree):
    counts = voxel_counts(octree)
    assert counts.tolist() == [len(voxel_cloud(octree, level)) for level in LEVELS]
    assert (np.diff(counts) >= 0).all() and counts[-1] == octree.leaf_count


@pytest.mark.parametrize("piece", [1, 7, 1000])
def test_pieces_are_bounded_and_the_same_voxels(octree, piece):
    runs = list(voxel_runs(octree, 4, piece=piece))
    assert max(len(run) for run in runs) <= piece
    nodes = np.concatenate([run.nodes for run in runs])
    assert len(nodes) == voxel_counts(octree)[4]
    assert set(nodes.tolist()) == {n for run in voxel_runs(octree, 4) for n in run.nodes.tolist()}
    for run in runs:
        np.testing.assert_array_equal(node_at(octree, run.level, run.cells), run.nodes)


def test_level_that_fits(octree):
    counts = voxel_counts(octree)
    for level in LEVELS:
        assert level_within(octree, int(counts[level])) == level
        if level:
            assert level_within(octree, int(counts[level]) - 1) == level - 1
    assert level_within(octree, 10**9, finest=2) == 2
    with pytest.raises(SettingError, match="at least 1"):
        level_within(octree, 0)
    with pytest.raises(SettingError, match="Level 6 is outside 0 to 5"):
        level_within(octree, 100, finest=6)
    with pytest.raises(SettingError, match="Level -1"):
        voxel_cloud(octree, -1)


@kernel
def _there_and_back(cells, keys, back):
    for row in range(len(cells)):
        keys[row] = cell_key(cells[row, 0], cells[row, 1], cells[row, 2])
        for axis in range(3):
            back[row, axis] = cell_coordinate(keys[row], axis)


@pytest.fixture
def cells():
    random = np.random.default_rng(0).integers(0, 1 << 21, (500, 3))
    return np.concatenate([random, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [2**21 - 1] * 3]])


def test_keys_have_the_bits_in_turn(cells):
    keys = morton_encode(cells)
    assert keys.dtype == np.uint64
    assert keys.tolist() == [plain_key(cell) for cell in cells.tolist()]
    assert keys[-6:].tolist() == [0, 1, 2, 4, 8, 2**63 - 1]


@pytest.mark.parametrize("count", [0, 1, 506])
@pytest.mark.parametrize("dtype", [np.int32, np.int64])
def test_kernels_have_the_same_keys(cells, count, dtype):
    cells = cells[:count].astype(dtype)
    keys, back = np.zeros(count, np.uint64), np.zeros((count, 3), np.int64)
    _there_and_back(cells, keys, back)
    np.testing.assert_array_equal(keys, morton_encode(cells))
    np.testing.assert_array_equal(back, cells)
