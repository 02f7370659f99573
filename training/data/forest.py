# SPDX-License-Identifier: GPL-3.0-or-later
"""Forest: several octrees in one set of arrays, so that a batch may mix their voxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...patchnet_addon.directional.node_light import NO_SIDES, NodeLight
from ...patchnet_addon.octree.octree import Nodes, Octree
from ...patchnet_addon.octree.pieces import NONE
from ...patchnet_addon.runtime.bounds import INT32_COUNT, check_count
from ...patchnet_addon.runtime.kernels import array_device


class ForestNodes(NamedTuple):
    """Nodes of T octrees, and boxes of their finest leaves.

    child_mask, first_child: of all octrees. first_boxed: (T,) int64, first node with a box in each octree; beyond the
    last node if none has. boxes: (b, 3) uint8 of all octrees. box_start: (T + 1,) int64, start of each octree's boxes.
    pieces, corners: empty; training sees voxels.
    """

    child_mask: np.ndarray
    first_child: np.ndarray
    first_boxed: np.ndarray
    boxes: np.ndarray
    box_start: np.ndarray
    pieces: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, eq=False)
class Forest:
    """Concatenated node arrays of all octrees; `root` (T,) int64 is the start of each."""

    root: np.ndarray
    nodes: ForestNodes
    luminance: np.ndarray
    normal: np.ndarray

    @property
    def light(self) -> NodeLight:
        """Luminance in the form of kernels: training uses one luminance for all sides."""
        return NodeLight(self.luminance, NO_SIDES)


@array_device
def tree_nodes(nodes, tree):
    """Nodes of one octree of a forest, as `Nodes`."""
    boxes = nodes.boxes[nodes.box_start[tree] : nodes.box_start[tree + 1]]
    return Nodes(nodes.child_mask, nodes.first_child, nodes.first_boxed[tree], boxes, nodes.pieces, nodes.corners)


def concatenate(octrees: Sequence[Octree]) -> Forest:
    """Copy octrees' node arrays into a forest; raises SettingError beyond 2^31 nodes: bricks store them in 32 bits."""
    counts = np.array([octree.node_count for octree in octrees], np.int64)
    root = np.concatenate([[0], np.cumsum(counts)[:-1]])
    check_count(
        int(counts.sum()), INT32_COUNT, "nodes of one training run's octrees", "train with fewer or coarser octrees"
    )
    boxed = [octree.nodes for octree in octrees]
    box_start = np.concatenate([[0], np.cumsum([len(each.boxes) for each in boxed])])
    shifted = [octree.first_child + np.uint32(start) for octree, start in zip(octrees, root, strict=True)]
    return Forest(
        root=root,
        nodes=ForestNodes(
            child_mask=np.concatenate([octree.child_mask for octree in octrees]),
            first_child=np.concatenate(shifted).astype(np.uint32),
            first_boxed=np.where(np.diff(box_start) > 0, root + [each.first_boxed for each in boxed], counts.sum()),
            boxes=np.concatenate([each.boxes for each in boxed]),
            box_start=box_start,
            pieces=NONE.triangle,
            corners=NONE.corners,
        ),
        luminance=np.concatenate([octree.luminance for octree in octrees]),
        normal=np.concatenate([octree.normal for octree in octrees]),
    )
