# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes and training samples per second on a torch device, beside the CPU in the same run, in turns.

Wall seconds, all cores, medians. What is timed ends with its results on the host, or with a wait for the GPU, so that
nothing still runs when the clock stops. Both sides have run before: nothing is compiled or allocated within the time.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np
import torch

from ...patchnet_addon.codes.encode import encode_octree, make_encoder
from ...patchnet_addon.network.compiled_encode import CompiledEncoder
from ...patchnet_addon.network.devices import CPU, device_title, found_device
from ...patchnet_addon.network.kinds import CODE_SIZE, MIXTURE, PAPER
from ...patchnet_addon.network.torch_encode import TorchEncoder
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.threads import limit_threads, usable_cores
from ..data.corpus import Corpus, corpus_of
from ..data.dataset import Dataset
from ..data.samples import SampleSettings, draw_samples
from ..network.losses import mean_errors
from ..run.crews import Crew, crew_for
from ..run.learner import Learner
from ..run.provenance import describe_machine, describe_versions
from ..run.trainer import encoder_type
from ..settings import ABSOLUTE, BF16, FP32, IMPROVED, TF32, TrainSettings
from .timing import Comparison, take_turns

Run = Callable[[], Any]
BATCHES = {2048: 100, 8192: 40}  # samples a step, and steps a run on a GPU
# The network that is shipped, and the paper's.
_SETTINGS = {
    MIXTURE.name: replace(IMPROVED, precision=FP32),
    PAPER.name: replace(IMPROVED, network=PAPER.name, decoder_width=0, loss=ABSOLUTE, precision=FP32),
}
_CPU_STEPS = 5  # a run, however large


@dataclass(frozen=True)
class DeviceBench:
    """Settings of the measurement: device, corners of the network alone, samples that are drawn."""

    device: str
    corners: int = 200_000
    samples: int = 200_000
    repeats: int = 5
    threads: int | None = None


def benchmark_device(octree: Octree, weights: Weights, bench: DeviceBench) -> Comparison:
    """Rates of `bench.device` and the CPU, and how far their results are apart.

    "cpu" measures torch on the CPU against our own kernels. Raises SettingError for a device that is not there, and for
    an octree without look-ahead.
    """
    device = found_device(bench.device, "--device")
    threads = bench.threads or usable_cores()
    torch.set_num_threads(usable_cores())
    measured, differences = _codes(octree, weights, device, bench)
    first, codes = measured[0], drain(encode_octree(octree, weights)).codes
    of_samples, apart = _samples(octree, device, threads, bench)
    details = {
        "device": device_title(device),
        "machine": describe_machine(),
        "versions": describe_versions(),
        "threads": threads,
        "clock": "wall",
        "repeats": bench.repeats,
        "nodes": octree.node_count,
        "codes": len(codes),
        "finding_corners_s": _finding_corners(octree, weights),
        "measured": measured + of_samples,
        "differences": differences | apart,
    }
    return Comparison("device", first["device"], first["cpu"], first["ratio"], details, unit="codes per second")


def _codes(
    octree: Octree, weights: Weights, device: str, bench: DeviceBench
) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Rates of encoding: of the whole octree, and of the network alone."""
    there, here = make_encoder(weights, "torch", device), make_encoder(weights, "compiled")
    assert isinstance(there, TorchEncoder)
    runs: dict[str, Run] = {
        "device": lambda: drain(encode_octree(octree, weights, encoder=there)),
        "cpu": lambda: drain(encode_octree(octree, weights, encoder=here)),
    }
    count = [len(run().codes) for run in runs.values()][-1]
    whole = _row("codes, whole octree", "codes/s", count, take_turns(runs, bench.repeats, all_cores=True))
    large = _record_chunks(octree, weights, bench.corners, there.chunk)
    small = _record_chunks(octree, weights, bench.corners, here.chunk)
    tensors = [tuple(torch.from_numpy(part).to(there.device) for part in chunk) for chunk in large]
    runs = {
        "device": lambda: _finished(there.device, [there.encode_tensors(*chunk) for chunk in tensors]),
        "cpu": lambda: [here(*chunk) for chunk in small],
    }
    for run in runs.values():
        run()
    seconds = take_turns(runs, bench.repeats, all_cores=True)
    corners = {"device": sum(len(rows) for _, rows in large), "cpu": sum(len(rows) for _, rows in small)}
    alone = _row("codes, network alone, one thread", "codes/s", corners, seconds)
    ours_exact = here(*small[-1])
    difference = np.abs(there(*small[-1]) - ours_exact).max()  # before they are rounded to half floats
    return [whole, alone], {"codes": float(difference), "largest_code": float(np.abs(ours_exact).max())}


class _Recorder:
    """Recorder: an `Encoder` that keeps the last chunks, which are those of the finest level, and encodes nothing."""

    def __init__(self, chunk: int, corners: int) -> None:
        self.chunk = chunk
        self.chunks: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=-(-corners // chunk))

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        self.chunks.append((blocks, rows))
        return np.zeros((len(rows), CODE_SIZE), np.float32)


def _record_chunks(octree: Octree, weights: Weights, corners: int, chunk: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Blocks and rows of the last chunks of an octree, of `chunk` corners each and about `corners` together.

    Raises SettingError if there are none.
    """
    recorder = _Recorder(chunk, corners)
    drain(encode_octree(octree, weights, encoder=recorder))
    if not recorder.chunks:
        raise SettingError("This octree has no corners to encode: take more --nodes")
    return list(recorder.chunks)


def _finding_corners(octree: Octree, weights: Weights) -> float:
    """Seconds of `encode_octree` until the first codes are there: it finds corners on the CPU, whatever encodes."""
    start = time.perf_counter()
    recorder = _Recorder(CompiledEncoder(weights).chunk, 1)
    for _ in encode_octree(octree, weights, encoder=recorder):
        if recorder.chunks:
            break
    return time.perf_counter() - start


def _samples(
    octree: Octree, device: str, threads: int, bench: DeviceBench
) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Rates of training steps of both kinds of network, and the CPU's by its threads."""
    settings = SampleSettings(min_level=min(5, octree.depth - 3), held_out=0.0)
    dataset = Dataset("shells", octree, drain(draw_samples(octree, bench.samples, settings)), {})
    measured: list[dict[str, Any]] = []
    differences: dict[str, float] = {}
    for kind in _SETTINGS:
        corpus, _ = corpus_of([dataset], nearby=_SETTINGS[kind].kind.mixes)
        for batch, steps in BATCHES.items():
            rows, apart = _steps(corpus, kind, batch, device, threads, steps if device != CPU else _CPU_STEPS, bench)
            measured += rows
            differences |= {name: max(value, differences.get(name, 0.0)) for name, value in apart.items()}
        measured += _by_threads(corpus, kind, threads)
    return measured, differences


def _steps(
    corpus: Corpus, kind: str, batch: int, device: str, threads: int, steps: int, bench: DeviceBench
) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Rates of steps of `batch` samples, and how far the errors of a step are from the CPU's."""
    settings = replace(_SETTINGS[kind], batch=batch)
    local = Training(corpus, settings, CPU, threads)
    others = {
        precision: Training(corpus, replace(settings, precision=precision), device, threads, steps)
        for precision in ((FP32, TF32, BF16) if device != CPU else (FP32,))
    }
    everyone = {"cpu": local} | others
    errors = {name: training().cpu() for name, training in everyone.items()}
    differences = {
        f"errors of a step, {kind}, {name}": float(((errors[name] - errors["cpu"]) / errors["cpu"]).abs().max())
        for name in others
    }
    seconds = take_turns(dict(everyone), bench.repeats, all_cores=True)
    measured = [
        _row(
            f"{kind}, {batch} samples a step, {name}", "samples/s",
            {"device": other.samples, "cpu": local.samples}, {"device": seconds[name], "cpu": seconds["cpu"]},
        )
        for name, other in others.items()
    ]  # fmt: skip
    for training in everyone.values():
        training.close()
    return measured, differences


def _by_threads(corpus: Corpus, kind: str, threads: int) -> list[dict[str, Any]]:
    """Rates of the CPU with all threads beside fewer of them."""
    counts = [count for count in (1, 2, 4, 8, 16, 32, 64) if count < threads]
    trainings = {count: Training(corpus, _SETTINGS[kind], CPU, count) for count in (*counts, threads)}
    for training in trainings.values():
        training()
    seconds = take_turns({str(count): training for count, training in trainings.items()}, 3, all_cores=True)
    for training in trainings.values():
        training.close()
    number = trainings[threads].samples
    return [
        _row(
            f"{kind}, 2048 samples a step, {threads} threads, not {count}", "samples/s", number,
            {"device": seconds[str(threads)], "cpu": seconds[str(count)]},
        )
        for count in counts
    ]  # fmt: skip


class Training:
    """Training steps on a device, a few at each call; returns the errors (2,) of the first of them."""

    def __init__(
        self, corpus: Corpus, settings: TrainSettings, device: str, threads: int, steps: int = _CPU_STEPS
    ) -> None:
        self._corpus, self._threads, self._steps = corpus, threads, steps
        self._learner = Learner(settings, corpus.lookahead, device)
        self._voxels = max(1, settings.batch // corpus.views_per_voxel)
        self._type = encoder_type(settings, 0.0, device)
        self._kept: Crew | None = None

    @property
    def samples(self) -> int:
        """Samples of a call."""
        return self._steps * self._voxels * int(self._corpus.views_per_voxel)

    def __call__(self) -> torch.Tensor:
        """Take the steps, and wait for the last one."""
        crew = self._kept or crew_for(self._learner, self._corpus, self._voxels, self._threads)
        first = None
        for _ in range(self._steps):
            gradients, sums = crew.gradients(self._learner.steps, self._type)
            with limit_threads(self._threads):
                self._learner.step(gradients, 1e-4)
            first = mean_errors(sums) if first is None else first
        assert first is not None
        _finished(self._learner.device, None)
        crew.settle()  # else it would gather outside the time
        self._kept = crew
        return first

    def close(self) -> None:
        """End the crew."""
        if self._kept is not None:
            self._kept.close()
        self._kept = None


def _finished(device: torch.device, result: Any) -> Any:
    """Wait for what runs on a GPU."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return result


def _row(what: str, unit: str, count: int | dict[str, int], seconds: dict[str, list[float]]) -> dict[str, Any]:
    """Rates of both sides as JSON values; count: of one run, of each side if they differ."""
    counts = count if isinstance(count, dict) else {"device": count, "cpu": count}
    rates = {who: counts[who] / median(values) for who, values in seconds.items()}
    runs = {f"{who}_runs": [round(value, 5) for value in values] for who, values in seconds.items()}
    return {"what": what, "unit": unit, **rates, "ratio": rates["device"] / rates["cpu"], "counts": counts, **runs}
