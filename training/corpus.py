# SPDX-License-Identifier: GPL-3.0-or-later
"""Corpus: the voxels of all data sets to train on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from .batches import Augmentation, Batch, gather_batch
from .forest import Forest


@dataclass(frozen=True, eq=False)
class Corpus:
    """Voxels of all data sets to train on: tree (G,) int32, voxel (G, 4), views (G, R, 12).

    lookahead: levels that they look ahead.
    """

    forest: Forest
    tree: np.ndarray
    voxel: np.ndarray
    views: np.ndarray
    lookahead: int = DEFAULT_LOOKAHEAD

    def batch(self, rows: np.ndarray, augmentation: Augmentation) -> Batch:
        """Batch of the voxels `rows` (V,)."""
        parts = self.tree[rows], self.voxel[rows], self.views[rows]
        return gather_batch(self.forest, *parts, augmentation, self.lookahead)
