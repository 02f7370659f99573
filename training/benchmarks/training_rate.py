# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples per second on the CPU, against the rate at which the step's matrix products alone would allow them.

Both in turns in one run, medians. A step is all that a run does again and again: batches are gathered, gradients
computed, the optimiser's step taken. What share of a step is products depends on the processor's matrix units, without
which products take several times as long; ONEDNN_MAX_CPU_ISA=AVX512_CORE_BF16 leaves them out. Beside the products as
the step does them stand those of a step in float32, which any processor multiplies alike: the ceiling of training
without bfloat16.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import torch

from ...patchnet_addon.network.encoders import MLP
from ...patchnet_addon.network.kinds import MIXTURE
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.threads import limit_threads
from ..data.corpus import corpus_of
from ..data.dataset import Dataset
from ..data.samples import SampleSettings, draw_samples
from ..data.tensor_batch import TensorBatch
from ..network.matrix_units import matrix_units_allowed
from ..run.crews import ALONE, StepPlan, ThreadCrew
from ..run.learner import Learner
from ..run.processes import Processes
from ..run.provenance import describe_machine, describe_versions
from ..run.torch_threads import torch_threads
from ..run.trainer import encoder_type
from ..settings import AUTO, IMPROVED, PAPER, TrainSettings
from .shells import octree_of_shells
from .step_products import Product, operations, replay, step_products
from .timing import Comparison, how_measured, take_turns

_WARM = 10  # runs before those that are measured
_BEFORE = 4  # steps before those of a run: in a training, what a step finds in the caches is another step's
_PRODUCT_STEPS = 4  # steps whose products are done
_TIMES = 8  # that each product is done in a row, see `step_products.py`
SETTINGS = {MIXTURE.name: IMPROVED, PAPER.network: PAPER}  # the preset by kind of network


@dataclass(frozen=True)
class TrainBench:
    """Settings of the measurement. nodes, samples: of the octree that is made where no data sets are given.

    steps: of a run. precision, encoder_width: as of `TrainSettings`.
    """

    nodes: int = 1_000_000
    samples: int = 400_000
    steps: int = 16
    repeats: int = 9
    threads: int = 1
    precision: str = AUTO
    encoder_width: int = MLP.width


def benchmark_training(datasets: Sequence[Dataset], bench: TrainBench) -> Comparison:
    """Rates of both kinds of network; `ratio`, of the first kind, is the share of what products alone would allow."""
    datasets = datasets or [_made(bench)]
    asked: dict[str, Any] = {"precision": bench.precision, "encoder_width": bench.encoder_width}
    with torch_threads(1):
        measured = {name: _measured(datasets, replace(settings, **asked), bench) for name, settings in SETTINGS.items()}
    first = measured[MIXTURE.name]
    details = {
        "machine": describe_machine(),
        "versions": describe_versions(),
        "threads": bench.threads,
        "encoder_width": bench.encoder_width,
        "matrix_units": has_matrix_units(),
        "data": [dataset.name for dataset in datasets],
        "kinds": measured,
        "repeats": bench.repeats,
        **how_measured(bench.threads > 1),
    }
    ours, peer = first["samples_per_s"], first["products_samples_per_s"]
    return Comparison("train", ours, peer, ours / peer, details, unit="samples per second")


def has_matrix_units() -> bool:
    """Whether torch multiplies bfloat16 in this processor's matrix units, as far as oneDNN's variable lets it."""
    capability = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return bool(capability.get("amx_bf16")) and matrix_units_allowed()


def _made(bench: TrainBench) -> Dataset:
    octree = octree_of_shells(bench.nodes)
    settings = SampleSettings(min_level=min(5, octree.depth - 3), held_out=0.0)
    return Dataset("shells", octree, drain(draw_samples(octree, bench.samples, settings)), {})


def _measured(datasets: Sequence[Dataset], settings: TrainSettings, bench: TrainBench) -> dict[str, Any]:
    """Rates of one kind as JSON values."""
    corpus, _ = corpus_of(datasets, nearby=settings.kind.mixes)
    learner = Learner(settings, corpus.lookahead)
    dtype = encoder_type(settings, 0.0)
    voxels = settings.batch // corpus.views_per_voxel
    crew = ThreadCrew(learner, StepPlan(corpus, settings, voxels, ALONE), bench.threads)

    numbers = itertools.count()  # every step is another one, as in a run: not two have as many blocks

    def take(count: int) -> None:
        for number in itertools.islice(numbers, count):
            gradients, _ = crew.gradients(number, dtype)
            with limit_threads(bench.threads):
                learner.step(gradients, settings.final_rate)
        crew.settle()  # else it would gather outside the time

    def replayed(count: int, dtype: torch.dtype) -> tuple[list[Callable[[], None]], int]:
        """Each thread's products of so many steps, and how many operations they are a step."""
        parts = [
            _products(StepPlan(corpus, settings, voxels, Processes(part, bench.threads)), count, dtype)
            for part in range(bench.threads)
        ]
        return [replay(products, _TIMES) for products in parts], sum(map(operations, parts)) // count

    count = min(bench.steps, _PRODUCT_STEPS)
    alone, work = replayed(count, dtype)
    plain, plain_work = replayed(1, torch.float32)
    with ThreadPoolExecutor(bench.threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        runs = {
            "step": lambda: take(bench.steps),
            "products": lambda: [job.result() for job in [pool.submit(each) for each in alone]],
            "float32_products": lambda: [job.result() for job in [pool.submit(each) for each in plain]],
        }
        for _ in range(_WARM):  # torch compiles products of sizes that it meets for the first time
            take(bench.steps)
        runs["products"]()
        seconds = take_turns(runs, bench.repeats, all_cores=bench.threads > 1, prepare=lambda: take(_BEFORE))
    crew.close()
    step = median(seconds["step"]) / bench.steps
    bound = median(seconds["products"]) / count / _TIMES
    plain_bound = median(seconds["float32_products"]) / _TIMES
    return {
        "batch": settings.batch, "precision": str(dtype).removeprefix("torch."),
        "samples_per_s": settings.batch / step, "products_samples_per_s": settings.batch / bound,
        "share": bound / step, "step_ms": 1e3 * step, "products_ms": 1e3 * bound,
        "gflop": work / 1e9, "gflops_of_products": work / bound / 1e9,
        "float32_products_samples_per_s": settings.batch / plain_bound, "share_of_float32": plain_bound / step,
        "float32_products_ms": 1e3 * plain_bound, "gflops_of_float32_products": plain_work / plain_bound / 1e9,
        **{f"{name}_runs": [round(value, 4) for value in values] for name, values in seconds.items()},
    }  # fmt: skip


def _products(plan: StepPlan, steps: int, dtype: torch.dtype) -> list[Product]:
    """Products of one thread's part of the first steps."""
    found: list[Product] = []
    for step in range(steps):
        batch = TensorBatch.of(plan.batch(step, 0, plan.own_voxels))
        found += step_products(batch, plan.settings.kind, plan.settings.encoder_width, dtype)
    return found
