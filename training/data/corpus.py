# SPDX-License-Identifier: GPL-3.0-or-later
"""Corpus: the training voxels of all data sets, without the held-out ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from .augmentation import Augmentation
from .batches import Batch, gather_batch
from .dataset import Dataset
from .forest import Forest, concatenate


@dataclass(frozen=True, eq=False)
class Corpus:
    """Training voxels of all data sets: tree (G,) int32, voxel (G, 4), views (G, R, 12).

    lookahead: levels of look-ahead. nearby: batches contain the luminances that a mixture needs.
    """

    forest: Forest
    tree: np.ndarray
    voxel: np.ndarray
    views: np.ndarray
    lookahead: int = DEFAULT_LOOKAHEAD
    nearby: bool = False

    @property
    def views_per_voxel(self) -> int:
        """Views of each voxel."""
        return int(self.views.shape[1])

    def batch(self, rows: np.ndarray, augmentation: Augmentation) -> Batch:
        """Batch of the voxels `rows` (V,)."""
        parts = self.tree[rows], self.voxel[rows], self.views[rows]
        return gather_batch(self.forest, *parts, augmentation, self.lookahead, nearby=self.nearby)


def corpus_of(datasets: Sequence[Dataset], *, nearby: bool = False) -> tuple[Corpus, dict[str, Corpus]]:
    """All training voxels, and the held-out ones by data set; raises PatchNetError if there are none.

    nearby: as in `Corpus`.
    """
    if not datasets:
        raise SettingError("There is nothing to train on: name at least one sample file")
    views = {dataset.samples.views.shape[1] for dataset in datasets}
    if len(views) != 1:
        raise SettingError(f"The sample files have {sorted(views)} views per voxel: draw them with the same number")
    lookaheads = {dataset.lookahead for dataset in datasets}
    if len(lookaheads) != 1:
        raise SettingError(
            f"The sample files look {sorted(lookaheads)} levels ahead: draw them with the same look-ahead"
        )
    (lookahead,) = lookaheads
    forest = concatenate([dataset.octree for dataset in datasets])
    parts = []
    held_out = {}
    for number, dataset in enumerate(datasets):
        samples = dataset.samples
        tree = np.full(len(samples.voxel), number, np.int32)
        keep, held = np.flatnonzero(~samples.held_out), np.flatnonzero(samples.held_out)
        parts.append((tree[keep], samples.voxel[keep], samples.views[keep]))
        if len(held):
            of_held = tree[held], samples.voxel[held], samples.views[held]
            held_out[dataset.name] = Corpus(forest, *of_held, lookahead, nearby)
    tree, voxel, view = (np.concatenate([part[k] for part in parts]) for k in range(3))
    if not len(tree):
        raise PatchNetError("All samples are held out for validation: draw more samples")
    return Corpus(forest, tree, voxel, view, lookahead, nearby), held_out
