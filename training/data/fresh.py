# SPDX-License-Identifier: GPL-3.0-or-later
"""Fresh samples: each training step draws voxels and views from the octrees anew, instead of sample files.

A draw depends only on the seed, the step's number and the voxel's index in the step, so that a run resumes exactly, and
threads and processes that share a step draw the same samples as one. Held-out parts of scenes are those of `patchnet
lab dataset` (methods 7.21).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.cells.morton import morton_decode
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ...patchnet_addon.runtime.kernels import kernel
from ..settings import SAMPLES, VALIDATION_VOXELS, VIEWS
from .augmentation import Augmentation
from .batches import Batch, gather_batch
from .corpus import Corpus
from .dataset import Dataset
from .forest import Forest, concatenate, tree_nodes
from .samples import VIEW_FIELDS, SampleSettings, begin_random, draw_voxel_views, uniform
from .voxel_choice import held_out_voxels, level_chances, usable_nodes

_VOXELS = 1000  # tries per place of a step, before the octree counts as hidden
_DRAWS, _HELD_OUT = 4, 5  # purposes of random numbers, beside the seed


@dataclass(frozen=True, eq=False)
class VoxelLists:
    """Candidate voxels of T octrees of up to L levels.

    voxel: (G, 4) uint16 level, x, y, z, by octree and level. start: (T, L + 1) int64, start of each level. below: (T,
    L) float64, cumulative probabilities of levels.
    """

    voxel: np.ndarray
    start: np.ndarray
    below: np.ndarray


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

    def batch_of_step(self, seed: int, step: int, places: slice, augmentation: Augmentation) -> Batch:
        """Augmented batch of some places of a step; raises PatchNetError if no voxel is visible."""
        drawn = self.draw(seed, step, places)
        return gather_batch(self.forest, *drawn, augmentation, self.lookahead, nearby=self.nearby)

    def draw(self, seed: int, step: int, places: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Octrees (V,), voxels (V, 4) and views (V, R, 12) at places of a step; raises as `batch_of_step`."""
        count = places.stop - places.start
        tree, voxel = np.empty(count, np.int32), np.empty((count, 4), np.uint16)
        views = np.empty((count, self.settings.views, VIEW_FIELDS), np.uint16)
        start = np.random.SeedSequence([seed, _DRAWS, step]).generate_state(1, np.uint64)[0]
        where = self.lists.voxel, self.lists.start, self.lists.below
        octrees = self.forest.nodes, self.forest.light, self.forest.root
        if not _draw(start, places.start, octrees, where, self.settings.lookahead, tree, voxel, views):
            raise PatchNetError("No voxel of an octree is visible from outside: give a deeper octree")
        return tree, voxel, views


def fresh_corpus_of(datasets: Sequence[Dataset], *, nearby: bool = False) -> tuple[FreshCorpus, dict[str, Corpus]]:
    """Octrees of data sets to draw from, and samples of their held-out parts by data set.

    Their own samples are ignored. Levels are as frequent as in sample files of default size. nearby: as in `Corpus`.
    Raises PatchNetError if there is nothing to draw.
    """
    if not datasets:
        raise SettingError("There is nothing to train on: name at least one octree")
    settings = [dataset.sample_settings for dataset in datasets]
    free: list[list[np.ndarray]] = []
    held_out = {}
    for dataset, how in zip(datasets, settings, strict=True):
        training, validation = _candidates(dataset.octree, how)
        free.append(training)
        if sum(map(len, validation)):
            held_out[dataset.name] = _held_out_samples(dataset.octree, validation, how, nearby)
    lists = _lists(free, SAMPLES // VIEWS // len(datasets))
    forest = concatenate([dataset.octree for dataset in datasets])
    return FreshCorpus(forest, lists, settings[0], nearby), held_out


def _candidates(octree: Octree, settings: SampleSettings) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Voxels (n, 4) uint16 with look-ahead by level, for training and for validation."""
    training, validation = [], []
    for level, nodes in usable_nodes(octree, settings.min_level, settings.lookahead).items():
        cells = morton_decode(octree.keys(level)[nodes])
        voxel = np.column_stack([np.full(len(nodes), level), cells]).astype(np.uint16)
        outside, inside = held_out_voxels(octree, voxel, settings.held_out, settings.seed)
        training.append(voxel[outside])
        validation.append(voxel[inside])
    if not sum(map(len, training)):
        raise PatchNetError("All voxels of an octree are held out for validation: lower the held-out share")
    return training, validation


def _lists(candidates: Sequence[Sequence[np.ndarray]], count: int) -> VoxelLists:
    """Lists of the voxels (n, 4) of each octree by level; count: as of `level_chances`."""
    levels = max(len(each) for each in candidates)
    sizes = np.zeros((len(candidates), levels), np.int64)
    below = np.ones((len(candidates), levels))
    for number, each in enumerate(candidates):
        sizes[number, : len(each)] = [len(voxel) for voxel in each]
        below[number, : len(each)] = np.cumsum(level_chances(sizes[number, : len(each)], count))
    ends = np.cumsum(sizes).reshape(sizes.shape)
    start = np.concatenate([ends[:, :1] - sizes[:, :1], ends], axis=1)
    return VoxelLists(np.concatenate([voxel for each in candidates for voxel in each]), start, below)


def _held_out_samples(
    octree: Octree, candidates: Sequence[np.ndarray], settings: SampleSettings, nearby: bool
) -> Corpus:
    """Samples of held-out voxels, as many as a validation uses."""
    forest = concatenate([octree])
    corpus = FreshCorpus(forest, _lists([candidates], VALIDATION_VOXELS), settings)
    drawn = corpus.draw(settings.seed, _HELD_OUT, slice(0, VALIDATION_VOXELS))
    return Corpus(forest, *drawn, settings.lookahead, nearby)


@kernel
def _draw(start, first, octrees, lists, lookahead, tree, voxel, views):
    nodes, light, root = octrees
    candidates, starts, below = lists
    state = np.empty(1, np.uint64)
    for place in range(len(tree)):
        begin_random(state, start, first + place)
        octree = min(np.int64(uniform(state) * len(root)), len(root) - 1)
        found = False
        for _ in range(_VOXELS):
            chance, level = uniform(state), 0
            while level < below.shape[1] - 1 and chance >= below[octree, level]:
                level += 1
            count = starts[octree, level + 1] - starts[octree, level]
            if count == 0:
                continue
            here = candidates[starts[octree, level] + min(np.int64(uniform(state) * count), count - 1)]
            node = here.astype(np.int64)
            own = tree_nodes(nodes, octree)
            if draw_voxel_views(state, own, light, root[octree], node, lookahead, views[place]):
                found = True
                break
        if not found:
            return False
        tree[place] = octree
        voxel[place] = here
    return True
