# SPDX-License-Identifier: GPL-3.0-or-later
"""Corpus: the training voxels of all data sets without the held-out ones, from sample files or drawn anew.

Each step of a run on fresh samples draws voxels and views from the octrees. A draw depends only on the seed, the step's
number and the voxel's index in the step, so that a run resumes exactly, and threads that share a step draw the same
samples as one. Held-out parts of scenes are those of `patchnet lab dataset` (methods 7.21).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ..settings import SAMPLES, VALIDATION_VOXELS, VIEWS
from .augmentation import Augmentation
from .batches import Batch, gather_batch
from .dataset import Dataset
from .forest import Forest, concatenate
from .samples import draw
from .voxel_choice import SampleSettings, VoxelLists, candidates

_DRAWS, _HELD_OUT = 4, 5  # purposes of random numbers, beside the seed


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
    """All training voxels, and the held-out ones by data set; raises PatchNetError if there are none."""
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


@dataclass(frozen=True, eq=False)
class FreshCorpus:
    """Octrees to draw from with equal probability, and settings of samples; nearby: as in `Corpus`."""

    forest: Forest
    lists: VoxelLists
    settings: SampleSettings
    nearby: bool = False

    @property
    def views_per_voxel(self) -> int:
        """Views of each voxel of a batch."""
        return self.settings.views

    @property
    def lookahead(self) -> int:
        """Levels that samples look ahead."""
        return self.settings.lookahead

    def batch_of_step(self, seed: int, step: int, count: int, augmentation: Augmentation) -> Batch:
        """Augmented batch of the first `count` places of a step; raises PatchNetError if no voxel is visible."""
        drawn = self.draw(seed, step, slice(0, count))
        return gather_batch(self.forest, *drawn, augmentation, self.lookahead, nearby=self.nearby)

    def draw(self, seed: int, step: int, places: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Octrees (V,), voxels (V, 4) and views (V, R, 12) at places of a step; raises as `batch_of_step`."""
        return draw(self.forest, self.lists, self.settings, (seed, _DRAWS, step), places)


def fresh_corpus_of(datasets: Sequence[Dataset], *, nearby: bool = False) -> tuple[FreshCorpus, dict[str, Corpus]]:
    """Octrees of data sets to draw from, and samples of their held-out parts by data set.

    Their own samples are ignored. Levels are as frequent as in sample files of default size. nearby: as in `Corpus`.
    Raises PatchNetError if there is nothing to draw.
    """
    settings = [dataset.sample_settings for dataset in datasets]
    free: list[list[np.ndarray]] = []
    held_out = {}
    for dataset, how in zip(datasets, settings, strict=True):
        training, validation = candidates(dataset.octree, how)
        free.append(training)
        if sum(map(len, validation)):
            # As many as a validation uses.
            own = FreshCorpus(concatenate([dataset.octree]), VoxelLists.of([validation], VALIDATION_VOXELS), how)
            drawn = own.draw(how.seed, _HELD_OUT, slice(0, VALIDATION_VOXELS))
            held_out[dataset.name] = Corpus(own.forest, *drawn, how.lookahead, nearby)
    lists = VoxelLists.of(free, SAMPLES // VIEWS // len(datasets))
    forest = concatenate([dataset.octree for dataset in datasets])
    return FreshCorpus(forest, lists, settings[0], nearby), held_out
