# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of a run: samples of each step, and threads that prefetch batches.

The samples of a step depend on the seed and its number only, for any device and threads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch

from ...patchnet_addon.network.devices import CPU, enough_memory
from ..data.augmentation import Augmentation
from ..data.batches import Batch
from ..data.corpus import Corpus, FreshCorpus
from ..data.tensor_batch import tensor_batch
from ..settings import TrainSettings

AnyCorpus = Corpus | FreshCorpus
_MOST_AHEAD = 16  # prefetched batches for a GPU
BATCHES = "batches of this size (--batch)"  # errors of a GPU with too little memory


@dataclass(frozen=True, eq=False)
class StepPlan:
    """Samples of each step of a run: `voxels` per step."""

    corpus: AnyCorpus
    settings: TrainSettings
    voxels: int

    def batch(self, step: int) -> Batch:
        """Batch of a step."""
        augmentation = Augmentation.none(self.voxels)
        if self.settings.augment:
            augmentation = Augmentation.random(self.voxels, np.random.default_rng([self.settings.seed, 2, step]))
        if isinstance(self.corpus, FreshCorpus):
            return self.corpus.batch_of_step(self.settings.seed, step, self.voxels, augmentation)
        return self.corpus.batch(rows_of_step(self.corpus, self.settings, self.voxels, step), augmentation)


def batches_ahead(
    plan: StepPlan, first: int, end: int, device: torch.device, threads: int
) -> Generator[Batch, None, None]:
    """Batches of steps `first` to `end` on a device, prefetched by one thread on the CPU, `threads` for a GPU."""
    ahead = 1 if device.type == CPU else min(threads, _MOST_AHEAD)

    def gathered(step: int) -> Batch:
        with enough_memory(BATCHES):
            return tensor_batch(plan.batch(step), device)

    with ThreadPoolExecutor(ahead, "PatchNet batches") as pool:
        waiting = deque(pool.submit(gathered, step) for step in range(first, min(first + ahead, end)))
        try:
            for step in range(first, end):
                batch = waiting.popleft().result()
                if step + ahead < end:
                    waiting.append(pool.submit(gathered, step + ahead))
                yield batch
        finally:
            pool.shutdown(cancel_futures=True)


def rows_of_step(corpus: Corpus, settings: TrainSettings, voxels: int, step: int) -> np.ndarray:
    """Voxels (voxels,) of a step; each epoch shuffles all voxels."""
    count = len(corpus.tree)
    first = step * voxels
    parts = []
    for epoch in range(first // count, (first + voxels - 1) // count + 1):
        begin = epoch * count
        parts.append(_order(settings.seed, epoch, count)[max(first - begin, 0) : first + voxels - begin])
    return np.concatenate(parts)


@lru_cache(maxsize=2)
def _order(seed: int, epoch: int, count: int) -> np.ndarray:
    return np.random.default_rng([seed, 1, epoch]).permutation(count)
