# SPDX-License-Identifier: GPL-3.0-or-later
"""Coded octree: an octree with a code at every corner of every voxel that has look-ahead."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..network.weights import Weights
from ..octree.octree import Octree


@dataclass(frozen=True, eq=False)
class CodedOctree:
    """Octree with codes by (level, corner); neighbouring voxels of a level share them (methods 7.10).

    weights: the network that made the codes and decodes them.
    codes: (C, 10) float16, level by level, within a level in Morton order of the corners.
    node_corners: (K, 8) uint32, rows in `codes` of the corners of each coded node, x fastest.
    """

    octree: Octree
    weights: Weights
    codes: np.ndarray
    node_corners: np.ndarray

    @cached_property
    def coded_index(self) -> np.ndarray:
        """(n,) int32: row of each node in `node_corners`, -1 for nodes without look-ahead."""
        coded = self.octree.look_ahead(self.weights.lookahead)
        return np.where(coded, np.cumsum(coded, dtype=np.int32) - 1, -1).astype(np.int32)

    @property
    def weights_hash(self) -> str:
        """Hash of the weights that made the codes."""
        return self.weights.hash

    @property
    def nbytes(self) -> int:
        """Bytes of the codes and of what finds them."""
        return self.codes.nbytes + self.node_corners.nbytes + 4 * self.octree.node_count
