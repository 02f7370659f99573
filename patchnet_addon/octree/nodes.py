# SPDX-License-Identifier: GPL-3.0-or-later
"""Node arrays of an octree, grouped for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Nodes(NamedTuple):
    """Arrays that lead from a node of an octree to its children; kernels that walk down take them.

    child_mask: (n,) uint8, bit x + 2y + 4z set if that child exists; 0 for leaves.
    first_child: (n,) uint32, node index of the first existing child; the others follow in order of their bit.
    """

    child_mask: np.ndarray
    first_child: np.ndarray
