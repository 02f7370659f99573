# SPDX-License-Identifier: GPL-3.0-or-later
"""Crews that carry a training step out: any number of CPU threads, or one GPU that threads gather batches for.

What a step learns from depends on the seed and its number alone, so all crews take the same steps, but for rounding.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from ..data.batches import Augmentation, Batch, block_values
from ..data.corpus import Corpus
from ..data.fresh import FreshCorpus
from ..data.padded_batch import BatchLayout
from ..network.replayed import Replayed
from ..settings import TrainSettings
from .learner import Learner
from .processes import Processes
from .torch_threads import torch_threads

_PART_VOXELS = 64  # in smaller parts of a step threads wait for the interpreter more than they compute
_STEP_VOXELS = 36  # that are learned from in the time in which the step is taken, in matrix units
_STEP_VOXELS_OF_TORCH = 8  # and by torch's products
_MOST_AHEAD = 16  # batches that wait for a GPU
_DRAWN_TOGETHER = 16  # steps whose augmentation is drawn at once: to begin takes longer than to draw
ALONE = Processes()
AnyCorpus = Corpus | FreshCorpus


class Crew(Protocol):
    """Crew of a run; `title` says in a few words what computes."""

    title: str

    def gradients(self, step: int, dtype: torch.dtype) -> tuple[list[Tensor], Tensor]:
        """Gradients (n,) of the parts of a step, which add up, and the sums (3,) of its errors for `mean_errors`."""

    def settle(self) -> None:
        """Wait until all is gathered that was begun: what a step leaves to be done beside the next one."""

    def close(self) -> None:
        """End the threads."""


def crew_for(learner: Learner, corpus: AnyCorpus, voxels: int, threads: int, processes: Processes = ALONE) -> Crew:
    """Crew for the learner's device, with `voxels` a step, of which it computes the share of its process."""
    plan = StepPlan(corpus, learner.settings, voxels, processes)
    return (ThreadCrew if learner.device.type == CPU else GpuCrew)(learner, plan, threads)


class _Part(NamedTuple):
    """Part of a step: its batch, and the share of the step that it is."""

    batch: Batch
    share: float


class ThreadCrew:
    """Threads that each gather and learn from one part of a step, with products on one thread.

    That suits small matrices better than threads inside every product, and a busy machine slows it less. There are as
    many parts as threads, so that rounding alone depends on their number; threads beyond those that a step has parts
    for work inside products. The first part is the calling thread's, which takes the step, too, and has less to learn
    from for it; the others gather the next step's batch meanwhile.
    """

    def __init__(self, learner: Learner, plan: StepPlan, threads: int) -> None:
        self._learner, self._plan = learner, plan
        parts = max(1, min(threads, plan.own_voxels // _PART_VOXELS))
        self._inside = max(1, threads // parts)
        self._parts = parts
        others = max(1, parts - 1)  # a pool has at least one thread, which begins with its first job
        self._pool = ThreadPoolExecutor(others, initializer=torch.set_num_threads, initargs=(self._inside,))
        self._ahead: list[Future[_Part]] = []
        self._ahead_of: tuple[int, torch.dtype] | None = None
        self.title = "1 CPU thread" if threads == 1 else f"{threads} CPU threads"

    def gradients(self, step: int, dtype: torch.dtype) -> tuple[list[Tensor], Tensor]:
        """Gradients of the parts of a step, and sums of its errors, see `Crew`."""
        if self._ahead_of != (step, dtype):
            self._ahead = self._gather(step, dtype)
        jobs = [self._pool.submit(self._learn, each, dtype) for each in self._ahead]
        self._ahead, self._ahead_of = self._gather(step + 1, dtype), (step + 1, dtype)
        with torch_threads(self._inside):
            first, last, *_ = self._cuts(dtype)
            own = self._gathered(step, first, last, dtype)
            found = [self._learner.gradients(own.batch, dtype, own.share)]
        gradients, sums = zip(*found, *(job.result() for job in jobs), strict=True)
        return list(gradients), torch.stack(sums).sum(0)

    def _cuts(self, dtype: torch.dtype) -> list[int]:
        """Where the parts of a step begin, and where the last one ends; the first one has less."""
        voxels, parts = self._plan.own_voxels, self._parts
        less = _STEP_VOXELS if self._learner.multiplies_in_units(dtype) else _STEP_VOXELS_OF_TORCH
        first = max((voxels + less) / parts - less, 1) if parts > 1 else voxels
        cuts: list[int] = np.linspace(first, voxels, parts).round().astype(int).tolist()
        return [0, *cuts]

    def _gather(self, step: int, dtype: torch.dtype) -> list[Future[_Part]]:
        """Parts of a step but the first, which the threads gather."""
        _, *cuts = itertools.pairwise(self._cuts(dtype))
        return [self._pool.submit(self._gathered, step, *cut, dtype) for cut in cuts]

    def _gathered(self, step: int, first: int, last: int, dtype: torch.dtype) -> _Part:
        narrow = dtype == torch.bfloat16 and self._learner.model.slices is not None  # as the encoder takes it
        batch = self._plan.batch(step, first, last, narrow=narrow)
        return _Part(batch, (last - first) / self._plan.voxels)

    def _learn(self, gathered: Future[_Part], dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        part = gathered.result()  # was begun before this, so no thread waits for itself
        return self._learner.gradients(part.batch, dtype, part.share)

    def settle(self) -> None:
        """Wait until all is gathered that was begun, see `Crew`."""
        wait(self._ahead)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(cancel_futures=True)


class GpuCrew:
    """GPU whose batches are gathered by threads, some steps ahead, and copied from pinned memory.

    Its work on batches of one shape is recorded and replayed (`replayed.py`).
    """

    def __init__(self, learner: Learner, plan: StepPlan, threads: int) -> None:
        self._learner, self._plan = learner, plan
        corpus, device = plan.corpus, learner.device
        values = block_values(corpus.lookahead, nearby=corpus.nearby)
        self._layout = BatchLayout(plan.own_voxels, corpus.views_per_voxel, values, corpus.nearby)
        self._there = torch.zeros(self._layout.size, dtype=torch.uint8, device=device)
        self._most = min(threads + 1, _MOST_AHEAD)
        self._free = deque(_Memory(self._layout.size, device) for _ in range(self._most + 1))
        self._ahead: deque[tuple[int, _Memory, Future[tuple[int, int]]]] = deque()
        self._steps: dict[tuple[torch.dtype, int], Callable[[], tuple[Tensor, Tensor]]] = {}
        self._pool = ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
        self.title = str(device)

    def gradients(self, step: int, dtype: torch.dtype) -> tuple[list[Tensor], Tensor]:
        """Gradients of a step as one part, and sums of its errors, see `Crew`; steps are asked for in their order.

        The next call overwrites the gradients.
        """
        following = self._ahead[-1][0] + 1 if self._ahead else step
        for number in range(following, step + self._most):
            memory = self._free.popleft()
            memory.wait()
            self._ahead.append((number, memory, self._pool.submit(self._gathered, number, memory)))
        number, memory, gathered = self._ahead.popleft()
        assert number == step
        size, pairs = gathered.result()
        memory.copy_to(self._there, size)
        self._free.append(memory)
        gradients, sums = self._of_shape(dtype, pairs)()
        return [gradients], sums.clone()

    def settle(self) -> None:
        """Wait until all is gathered that was begun, see `Crew`."""
        wait(gathered for _, _, gathered in self._ahead)

    def _gathered(self, step: int, memory: _Memory) -> tuple[int, int]:
        return self._layout.write(self._plan.batch(step, 0, self._plan.own_voxels), memory.array)

    def _of_shape(self, dtype: torch.dtype, pairs: int) -> Callable[[], tuple[Tensor, Tensor]]:
        """What a step does with the batch that lies on the GPU, with `pairs` of a slice."""
        if (dtype, pairs) not in self._steps:
            batch, share = self._layout.read(self._there, pairs), self._plan.share
            work = partial(self._learner.gradients, batch, dtype, share)
            recorded = self._learner.model.slices is not None  # encoders that convolve read tables of the host
            self._steps[dtype, pairs] = Replayed(work, self._learner.device) if recorded else work
        return self._steps[dtype, pairs]

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(cancel_futures=True)
        self._ahead.clear()


class _Memory:
    """Memory of the host that a batch is gathered in, and copied to a GPU from while the host goes on."""

    def __init__(self, size: int, device: torch.device) -> None:
        self._gpu = device if device.type == "cuda" else None
        self._tensor = torch.empty(size, dtype=torch.uint8, pin_memory=self._gpu is not None)
        self._copied: torch.cuda.Event | None = None
        self.array = self._tensor.numpy()

    def copy_to(self, there: Tensor, size: int) -> None:
        """Begin to copy the first bytes."""
        there[:size].copy_(self._tensor[:size], non_blocking=True)
        if self._gpu is not None:
            self._copied = torch.cuda.Event()
            self._copied.record(torch.cuda.current_stream(self._gpu))

    def wait(self) -> None:
        """Wait until all is copied."""
        if self._copied is not None:
            self._copied.synchronize()


@dataclass(frozen=True, eq=False)
class StepPlan:
    """Plan of what each step of a run learns from: `voxels` a step, of which this process takes its share."""

    corpus: AnyCorpus
    settings: TrainSettings
    voxels: int
    processes: Processes

    @property
    def own_voxels(self) -> int:
        """Voxels of a step that are this process's."""
        return len(range(self.voxels)[self.processes.part(self.voxels)])

    @property
    def share(self) -> float:
        """Share of a step that is this process's."""
        return self.own_voxels / self.voxels

    def of_step(self, step: int) -> tuple[np.ndarray, Augmentation]:
        """Voxels of this process's share of a step, and how they are augmented; of a corpus of samples."""
        assert isinstance(self.corpus, Corpus)
        rows, augmentation = plan_of_step(self.corpus, self.settings, self.voxels, step)
        own = self.processes.part(len(rows))
        return rows[own], augmentation.part(own.start, own.stop)

    def batch(self, step: int, first: int, last: int, *, narrow: bool = False) -> Batch:
        """Batch of voxels `first` to `last`, excluded, of this process's share of a step; narrow: as of `Batch`."""
        if isinstance(self.corpus, Corpus):
            rows, augmentation = self.of_step(step)
            return self.corpus.batch(rows[first:last], augmentation.part(first, last), narrow=narrow)
        begin = self.processes.part(self.voxels).start
        places = slice(begin + first, begin + last)
        augmentation = augmentation_of_step(self.settings, self.voxels, step).part(places.start, places.stop)
        return self.corpus.batch_of_step(self.settings.seed, step, places, augmentation, narrow=narrow)


def plan_of_step(corpus: Corpus, settings: TrainSettings, voxels: int, step: int) -> tuple[np.ndarray, Augmentation]:
    """Voxels (voxels,) of a step and how they are augmented, by seed and step alone."""
    return rows_of_step(corpus, settings, voxels, step), augmentation_of_step(settings, voxels, step)


def augmentation_of_step(settings: TrainSettings, voxels: int, step: int) -> Augmentation:
    """Augmentation of the voxels of a step, by seed and step alone."""
    if not settings.augment:
        return Augmentation.none(voxels)
    first = step % _DRAWN_TOGETHER * voxels
    return _augmentations(settings.seed, step // _DRAWN_TOGETHER, voxels).part(first, first + voxels)


@lru_cache(maxsize=2)
def _augmentations(seed: int, number: int, voxels: int) -> Augmentation:
    """Augmentation of the steps of a group of them, of so many voxels each."""
    return Augmentation.random(_DRAWN_TOGETHER * voxels, np.random.default_rng([seed, 2, number]))


def rows_of_step(corpus: Corpus, settings: TrainSettings, voxels: int, step: int) -> np.ndarray:
    """Voxels (voxels,) of a step; each epoch runs through all of them in a new order."""
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
