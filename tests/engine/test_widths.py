# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts that 32 bits cannot hold are refused by name, before anything is allocated for them."""

from types import SimpleNamespace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.patch_rays import render_patches
from patchnet.patchnet_addon.codes.patches import voxel_blocks
from patchnet.patchnet_addon.lightmap.sample_sharing import crowding_of
from patchnet.patchnet_addon.network.weights import Weights
from patchnet.patchnet_addon.octree.file import _inconsistency
from patchnet.patchnet_addon.octree.levels import number_children
from patchnet.patchnet_addon.octree.voxelize import clip_batch
from patchnet.patchnet_addon.runtime.bounds import INT32_COUNT, UINT32_COUNT, check_count
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain

LARGE = SimpleNamespace(node_count=INT32_COUNT + 1, depth=9)
NODES = r"2,147,483,649 nodes are more than numbers of 31 bits can name .2,147,483,648.: choose a smaller depth"


class Sized:
    """What has a length and nothing else."""

    def __init__(self, count, name=""):
        self.count, self.name = count, name

    def __len__(self):
        return self.count


def test_bounds():
    check_count(INT32_COUNT, INT32_COUNT, "nodes", "")
    check_count(UINT32_COUNT, UINT32_COUNT, "nodes", "")
    with pytest.raises(SettingError, match=r"4,294,967,297 rows are more than numbers of 32 bits .*: do this"):
        check_count(UINT32_COUNT + 1, UINT32_COUNT, "rows", "do this")


@pytest.mark.parametrize(
    "use",
    [
        lambda: drain(encode_octree(LARGE, Weights.random())),
        lambda: voxel_blocks(LARGE, np.zeros(1, np.int64)),
        lambda: render_patches(LARGE, None),
    ],
)
def test_nodes_of_blocks_and_bricks(use):
    with pytest.raises(SettingError, match=NODES):
        use()


def test_children():
    with pytest.raises(SettingError, match="4,294,967,297 nodes are more than numbers of 32 bits"):
        number_children(Sized(UINT32_COUNT + 1))


def test_an_octree_file():
    masks = SimpleNamespace(size=UINT32_COUNT + 1, shape=(UINT32_COUNT + 1,))
    arrays = dict.fromkeys(("child_mask", "area_world", "first_child", "luminance"), masks)
    arrays |= {"level_start": np.zeros(5, np.int64), "normal": SimpleNamespace(shape=(masks.size, 3))}
    assert "4,294,967,297 nodes, more than numbers of 32 bits" in _inconsistency(arrays, 3)


def test_triangles():
    with pytest.raises(SettingError, match=r"2,147,483,649 triangles of 'Rock' are more than .*: split the object"):
        next(clip_batch(Sized(INT32_COUNT + 1, "Rock"), None, None, 3))
    with pytest.raises(SettingError, match=r"2,147,483,649 triangles are more than .*: voxelize fewer objects"):
        drain(crowding_of(SimpleNamespace(triangle_count=INT32_COUNT + 1), None, None))
