# SPDX-License-Identifier: GPL-3.0-or-later
"""Node arrays of an octree, grouped for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Nodes(NamedTuple):
    """Arrays from nodes of an octree to their children, for kernels that descend.

    child_mask: (n,) uint8, bit x + 2y + 4z set if that child exists; 0 for leaves.
    first_child: (n,) uint32, node index of the first existing child; the others follow in order of their bit.
    """

    child_mask: np.ndarray
    first_child: np.ndarray


class BoxedNodes(NamedTuple):
    """Nodes of an octree and boxes of its finest leaves, for kernels that trace rays.

    child_mask, first_child: as `Nodes` holds them. first_boxed: the first node with a box; all later ones have one.
    boxes: (b, 3) uint8 as `Octree.leaf_box`; without boxes, `first_boxed` is above all nodes.
    """

    child_mask: np.ndarray
    first_child: np.ndarray
    first_boxed: int
    boxes: np.ndarray


def without_boxes(child_mask: np.ndarray, first_child: np.ndarray) -> BoxedNodes:
    """Nodes whose leaves are whole voxels."""
    return BoxedNodes(child_mask, first_child, len(child_mask), np.empty((0, 3), np.uint8))
