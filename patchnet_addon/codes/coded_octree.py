# SPDX-License-Identifier: GPL-3.0-or-later
"""Coded octree: an octree with a code at every corner of every voxel that has look-ahead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..network.weights import Weights
from ..octree.octree import Octree
from .corner_rows import CodedNodes


@dataclass(frozen=True, eq=False)
class CodedOctree:
    """Octree with codes by (level, corner); neighbouring voxels of a level share them (methods 7.10).

    weights: the network that encodes and decodes the codes.
    codes: (C, 10) float16, level by level, within a level in the order z, y, x of the corners.
    corner_rows: (K, 3) uint32, rows of the codes of each coded voxel's corners, see `corner_rows.py`.
    nodes: coded nodes, which map nodes to lines of `corner_rows`.
    corner_cells: (C, 8) uint32, finer cells around the corners, for weights with a luminance mixture; None for others.
    """

    octree: Octree
    weights: Weights
    codes: np.ndarray
    corner_rows: np.ndarray
    nodes: CodedNodes
    corner_cells: np.ndarray | None = None

    @property
    def coded_count(self) -> int:
        """Number K of voxels with codes."""
        return len(self.corner_rows)

    @property
    def nbytes(self) -> int:
        """Bytes of the codes and their index, which takes about 12 per coded voxel."""
        corners = 0 if self.corner_cells is None else self.corner_cells.nbytes
        return self.codes.nbytes + corners + self.corner_rows.nbytes + sum(array.nbytes for array in self.nodes)
