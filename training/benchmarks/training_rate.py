# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples per second: all that a run does again and again, on the CPU, and on a GPU beside it."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

from ...patchnet_addon.network.devices import CPU, device_title
from ...patchnet_addon.network.encoders import MLP
from ...patchnet_addon.network.kinds import MIXTURE
from ...patchnet_addon.runtime.progress import drain
from ..data.corpus import corpus_of
from ..data.dataset import Dataset
from ..data.samples import SampleSettings, draw_samples
from ..run.learner import Learner
from ..run.provenance import describe_machine, describe_versions
from ..run.steps import StepPlan, batches_ahead
from ..run.torch_threads import torch_threads
from ..run.trainer import encoder_type
from ..settings import AUTO, IMPROVED, PAPER, TrainSettings
from .shells import octree_of_shells
from .timing import Comparison

_WARM = 4  # steps before those that are measured
SETTINGS = {MIXTURE.name: IMPROVED, PAPER.network: PAPER}  # the preset by kind of network


@dataclass(frozen=True)
class TrainBench:
    """Settings of the measurement. nodes, samples: of the octree that is made where no data sets are given.

    steps: of a run. device, threads: as of `RunOptions`. precision, encoder_width: as of `TrainSettings`.
    """

    nodes: int = 1_000_000
    samples: int = 400_000
    steps: int = 16
    repeats: int = 9
    device: str = CPU
    threads: int = 1
    precision: str = AUTO
    encoder_width: int = MLP.width


def benchmark_training(datasets: Sequence[Dataset], bench: TrainBench) -> Comparison:
    """Rates of both kinds of network; those of a GPU have the CPU's as their peer."""
    datasets = datasets or [_made(bench)]
    devices = [bench.device] if bench.device == CPU else [bench.device, CPU]
    rows = [_measured(datasets, name, bench, device) for name in SETTINGS for device in devices]
    ours, peer = rows[0]["samples_per_s"], rows[1]["samples_per_s"] if len(devices) > 1 else None
    details = {
        "machine": describe_machine(bench.device),
        "versions": describe_versions(),
        "threads": bench.threads,
        "encoder_width": bench.encoder_width,
        "data": [dataset.name for dataset in datasets],
        "rows": rows,
        "repeats": bench.repeats,
    }
    return Comparison("train", ours, peer, ours / peer if peer else None, details, unit="samples per second")


def _made(bench: TrainBench) -> Dataset:
    octree = octree_of_shells(bench.nodes)
    settings = SampleSettings(min_level=min(5, octree.depth - 3), held_out=0.0)
    return Dataset("shells", octree, drain(draw_samples(octree, bench.samples, settings)), {})


def _measured(datasets: Sequence[Dataset], kind: str, bench: TrainBench, device: str) -> dict[str, Any]:
    """Medians of one kind of network on one device as JSON values."""
    settings = replace(SETTINGS[kind], precision=bench.precision, encoder_width=bench.encoder_width)
    corpus, _ = corpus_of(datasets, nearby=settings.kind.mixes)
    plan = StepPlan(corpus, settings, settings.batch // corpus.views_per_voxel)
    learner = Learner(settings, corpus.lookahead, device)
    with torch_threads(bench.threads):
        steps = _steps(learner, plan, settings, bench)
        seconds = [_seconds_of(steps, bench.steps) for _ in range(bench.repeats)]
        steps.close()
    wall, processor = (median(values) / bench.steps for values in zip(*seconds, strict=True))
    return {
        "kind": kind, "device": device_title(device), "batch": settings.batch,
        "precision": str(encoder_type(settings, 0.0, device)).removeprefix("torch."), "step_ms": 1e3 * wall,
        "samples_per_s": settings.batch / wall, "samples_per_processor_s": settings.batch / processor,
        "wall_runs": [round(run, 4) for run, _ in seconds],
    }  # fmt: skip


def _steps(learner: Learner, plan: StepPlan, settings: TrainSettings, bench: TrainBench) -> Generator[None, None, None]:
    """Steps as a run takes them, one for each call, and those before that nobody measures."""
    dtype, end = encoder_type(settings, 0.0, str(learner.device)), _WARM + bench.steps * bench.repeats
    for batch in batches_ahead(plan, 0, end, learner.device, bench.threads):
        gradients, sums = learner.differentiate(batch, dtype)
        learner.step(gradients, settings.final_rate)
        sums.tolist()  # waits for a GPU
        if learner.steps > _WARM:
            yield


def _seconds_of(steps: Iterator[None], count: int) -> tuple[float, float]:
    """Wall and processor seconds of so many steps."""
    wall, processor = time.perf_counter(), time.process_time()
    for _ in range(count):
        next(steps)
    return time.perf_counter() - wall, time.process_time() - processor
