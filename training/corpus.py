# SPDX-License-Identifier: GPL-3.0-or-later
"""Corpus: the voxels of all data sets to train on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .batches import Augmentation, Batch, gather_batch
from .forest import Forest


@dataclass(frozen=True, eq=False)
class Corpus:
    """Voxels of all data sets to train on: tree (G,) int32, voxel (G, 4), views (G, R, 12)."""

    forest: Forest
    tree: np.ndarray
    voxel: np.ndarray
    views: np.ndarray

    def batch(self, rows: np.ndarray, augmentation: Augmentation) -> Batch:
        """Batch of the voxels `rows` (V,)."""
        return gather_batch(self.forest, self.tree[rows], self.voxel[rows], self.views[rows], augmentation)
