# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples per second of both kinds of network, on the CPU, and on a GPU beside it.

A step is the loop of a run: gather a batch, compute gradients, step the optimizer.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Generator, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

from ....patchnet_addon.network.devices import CPU, device_title, found_device
from ....patchnet_addon.network.kinds import MIXTURE
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.threads import usable_cores
from ...benchmarks.shells import octree_of_shells
from ...benchmarks.timing import comparison
from ...data.corpus import corpus_of
from ...data.dataset import Dataset, load_dataset, sample_files
from ...data.samples import draw_samples
from ...data.voxel_choice import SampleSettings
from ...run import torch_threads
from ...run.learner import Learner
from ...run.provenance import describe_machine, describe_versions
from ...run.steps import StepPlan, batches_ahead
from ...run.trainer import encoder_type
from ...settings import IMPROVED, PAPER, TrainSettings

_WARM = 4  # warm-up steps
_STEPS = 16  # of a run
_SETTINGS = {MIXTURE.name: IMPROVED, PAPER.network: PAPER}  # the preset by kind of network


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Rates of both kinds of network, on a GPU with the CPU's as peer; raises PatchNetError."""
    args.threads = args.threads or usable_cores()
    device = found_device(args.device, "--device")
    datasets = [load_dataset(path) for path in sample_files(args.datasets)] or [_made(args)]
    rows = [_measured(datasets, kind, args, each) for kind in _SETTINGS for each in dict.fromkeys((device, CPU))]
    details = {
        "machine": describe_machine(device),
        "versions": describe_versions(),
        "threads": args.threads,
        "encoder_width": args.encoder_width,
        "data": [dataset.name for dataset in datasets],
        "rows": rows,
        "repeats": args.repeats,
    }
    ours, peer = rows[0]["samples_per_s"], None if device == CPU else rows[1]["samples_per_s"]
    return comparison("train", ours, peer, details, "samples per second")


def _made(args: argparse.Namespace) -> Dataset:
    octree = octree_of_shells(args.nodes)
    settings = SampleSettings(min_level=min(5, octree.depth - 3), held_out=0.0)
    return Dataset("shells", octree, drain(draw_samples(octree, args.samples, settings)), {})


def _measured(datasets: Sequence[Dataset], kind: str, args: argparse.Namespace, device: str) -> dict[str, Any]:
    """Medians of one kind of network on one device as JSON values."""
    settings = replace(_SETTINGS[kind], precision=args.precision, encoder_width=args.encoder_width)
    corpus, _ = corpus_of(datasets, nearby=settings.kind.mixes)
    plan = StepPlan(corpus, settings, settings.batch // corpus.views_per_voxel)
    learner = Learner(settings, corpus.lookahead, device)
    runs = []
    with torch_threads(args.threads):
        steps = _steps(learner, plan, settings, args)
        for _ in range(args.repeats):
            start = time.perf_counter(), time.process_time()
            for _ in range(_STEPS):
                next(steps)
            runs.append((time.perf_counter() - start[0], time.process_time() - start[1]))
        steps.close()
    wall, processor = (median(values) / _STEPS for values in zip(*runs, strict=True))
    return {
        "kind": kind, "device": device_title(device), "batch": settings.batch,
        "precision": str(encoder_type(settings, 0.0, device)).removeprefix("torch."), "step_ms": 1e3 * wall,
        "samples_per_s": settings.batch / wall, "samples_per_processor_s": settings.batch / processor,
        "wall_runs": [round(run, 4) for run, _ in runs],
    }  # fmt: skip


def _steps(
    learner: Learner, plan: StepPlan, settings: TrainSettings, args: argparse.Namespace
) -> Generator[None, None, None]:
    """Training steps, one per call, after warm-up."""
    dtype, end = encoder_type(settings, 0.0, str(learner.device)), _WARM + _STEPS * args.repeats
    for batch in batches_ahead(plan, 0, end, learner.device, args.threads):
        gradients, sums = learner.differentiate(batch, dtype)
        learner.step(gradients, settings.final_rate)
        sums.tolist()  # synchronizes with a GPU
        if learner.steps > _WARM:
            yield
