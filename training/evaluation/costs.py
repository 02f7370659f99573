# SPDX-License-Identifier: GPL-3.0-or-later
"""Cost of refinement strategies: rays per pixel, and milliseconds per frame on one thread.

A strategy's frame is all that it takes from camera to order: tracing the preview and the strategy's own rays, decoding,
scoring, sorting. So strategies that trace or decode more are dearer by what they really take.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.runtime.file_kinds import COSTS
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.replace import replaced_file
from ...patchnet_addon.runtime.threads import limit_threads
from ...patchnet_addon.sampling.predicted import PREDICTED
from ...patchnet_addon.sampling.refine import refinement_order
from ...patchnet_addon.sampling.staged_strategy import StagedStrategy, scores_in_stages
from ...patchnet_addon.sampling.strategy import REFERENCE, Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.supersample import supersample, supersample_pixels
from ..benchmarks.timing import take_turns
from .curves import BUDGETS
from .predicted import predicted_names
from .scene_codes import SceneCodes

REFERENCE_SIDE = 32
_REFERENCE_PIXELS = 512  # of a frame, enough to be timed
STAGED_BUDGET = 0.3
_MEASURED = (
    0.0,
    0.05,
    0.06,
    0.07,
    0.1,
    0.2,
    0.24,
    0.25,
    0.3,
    0.5,
    0.7,
    0.74,
    0.75,
    1.0,
)  # budgets; between them costs are on a line


CYCLES_MS_PER_PIXEL = 0.2
"""Processor milliseconds that 64 paths of Cycles take in a pixel, at the rate that `patchnet bench bake` says of camera
renders: 0.3 million paths a second."""


@dataclass(frozen=True)
class Costs:
    """Costs on one thread, medians over frames of processor milliseconds.

    ms_per_frame: by strategy. ms_by_budget: at each of BUDGETS by those that rank in stages, whose frame of
    `ms_per_frame` is that of STAGED_BUDGET. uniform_ms: of a picture of side x side rays in each pixel, by side.
    predicted_ms: of predicted pictures by name. reference_ms_per_pixel: of 32x32 rays in a pixel that is refined.
    """

    ms_per_frame: dict[str, float]
    ms_by_budget: dict[str, list[float]]
    uniform_ms: dict[int, float]
    predicted_ms: dict[str, float]
    reference_ms_per_pixel: float

    def as_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)

    @classmethod
    def of_json(cls, values: Mapping[str, Any]) -> Costs:
        """Costs of `as_json`."""
        uniform = {int(side): ms for side, ms in values["uniform_ms"].items()}
        by_budget, predicted = dict(values["ms_by_budget"]), dict(values["predicted_ms"])
        return cls(values["ms_per_frame"], by_budget, uniform, predicted, values["reference_ms_per_pixel"])


def measure_costs(
    codes: SceneCodes,
    cameras: Sequence[Camera],
    strategies: Mapping[str, Strategy],
    sides: Sequence[int],
    repeats: int,
) -> Costs:
    """Measure frames by every strategy, in turns; those that read the reference have no price."""
    coded = codes.coded
    staged = {name: strategy for name, strategy in strategies.items() if isinstance(strategy, StagedStrategy)}
    known = [name for name, strategy in strategies.items() if REFERENCE not in strategy.needs and name not in staged]
    frames: dict[str, list[float]] = {name: [] for name in known}
    stages: dict[tuple[str, float], list[float]] = {(name, budget): [] for name in staged for budget in _MEASURED}
    uniform: dict[int, list[float]] = {side: [] for side in sides}
    pictures = dict(zip(predicted_names(list(codes.networks)), [coded, *codes.networks.values()], strict=True))
    predicted: dict[str, list[float]] = {name: [] for name in pictures}
    refined = []
    with limit_threads(1):
        for camera in cameras:
            pixels = _spread_pixels(camera)
            runs = {name: _frame(codes.of(strategies[name]), camera, strategies[name]) for name in known}
            runs |= {f"{name} {budget}": _staged(coded, camera, staged[name], budget) for name, budget in stages}
            runs |= {f"uniform {side}": _uniform(coded, camera, side) for side in sides}
            runs |= {f"picture {name}": _predicted(by, camera) for name, by in pictures.items()}
            runs["reference"] = _reference(coded, camera, pixels)
            for run in runs.values():
                run()  # compiles
            seconds = {name: median(times) for name, times in take_turns(runs, repeats).items()}
            for name in known:
                frames[name].append(1e3 * seconds[name])
            for name, budget in stages:
                stages[name, budget].append(1e3 * seconds[f"{name} {budget}"])
            for side in sides:
                uniform[side].append(1e3 * seconds[f"uniform {side}"])
            for name in pictures:
                predicted[name].append(1e3 * seconds[f"picture {name}"])
            refined.append(1e3 * seconds["reference"] / len(pixels))
    by_budget = {
        name: np.interp(BUDGETS, _MEASURED, [median(stages[name, budget]) for budget in _MEASURED]).tolist()
        for name in staged
    }
    at_budget = {name: times[BUDGETS.tolist().index(STAGED_BUDGET)] for name, times in by_budget.items()}
    return Costs(
        {name: median(times) for name, times in frames.items()} | at_budget,
        by_budget,
        {side: median(times) for side, times in uniform.items()},
        {name: median(times) for name, times in predicted.items()},
        median(refined),
    )


def total_ms(values: Mapping[str, Any], strategy: str, ms_per_pixel: float) -> np.ndarray:
    """Milliseconds (B,) of a frame at each budget: what a strategy takes, and the samples that the budget asks for.

    values: of a scene in the results. ms_per_pixel: of the samples of a refined pixel.
    """
    pixels = values["active_pixels"] / max(values["frames"], 1)
    own = values.get("ms_by_budget", {}).get(strategy, values["ms_per_frame"][strategy])
    return np.asarray(own) + np.asarray(values["budgets"]) * pixels * ms_per_pixel


def write_costs(costs: Costs, path: Path, key: str) -> None:
    """Keep costs in a file. key: of everything that they depend on. Raises OutputError if it cannot be written."""
    with replaced_file(path, COSTS) as file:
        file.write(json.dumps({"key": key} | costs.as_json()).encode())


def read_costs(path: Path, key: str) -> Costs | None:
    """Costs of `write_costs`; None if they are not there, damaged, or of something else."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        return Costs.of_json(kept) if kept["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _frame(coded: CodedOctree, camera: Camera, strategy: Strategy):  # type: ignore[no-untyped-def]
    def run() -> None:
        buffers = drain(trace_view(coded.octree, camera, [strategy], coded=coded, reference=False))
        refinement_order(buffers, strategy.scores(buffers))

    return run


def _staged(coded: CodedOctree, camera: Camera, strategy: StagedStrategy, budget: float):  # type: ignore[no-untyped-def]
    def run() -> None:
        buffers, scores = drain(scores_in_stages(coded.octree, camera, strategy, budget, coded))
        refinement_order(buffers, scores)

    return run


def _predicted(coded: CodedOctree, camera: Camera):  # type: ignore[no-untyped-def]
    def run() -> None:
        buffers = drain(trace_view(coded.octree, camera, [], coded=coded, reference=False, unrefined=PREDICTED))
        assert buffers.predicted is not None  # which computes it

    return run


def _uniform(coded: CodedOctree, camera: Camera, side: int):  # type: ignore[no-untyped-def]
    return lambda: drain(supersample(coded.octree, camera, side))


def _reference(coded: CodedOctree, camera: Camera, pixels: np.ndarray):  # type: ignore[no-untyped-def]
    return lambda: supersample_pixels(coded.octree, camera, pixels, REFERENCE_SIDE)


def _spread_pixels(camera: Camera) -> np.ndarray:
    """Pixels (N,) int64 all over the picture."""
    count = min(_REFERENCE_PIXELS, camera.pixel_count)
    return np.linspace(0, camera.pixel_count - 1, count).astype(np.int64)
