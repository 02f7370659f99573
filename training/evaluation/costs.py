# SPDX-License-Identifier: GPL-3.0-or-later
"""Cost of refinement strategies: rays per pixel, and milliseconds per frame on one thread.

A strategy's time covers everything from camera to order: tracing the preview and the strategy's own rays, decoding,
scoring, sorting. It includes the cost of additional rays and decoding of expensive strategies.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.replace import replaced_file
from ...patchnet_addon.runtime.threads import limit_threads
from ...patchnet_addon.sampling.predicted import PREDICTED
from ...patchnet_addon.sampling.refine import refinement_order
from ...patchnet_addon.sampling.strategy import REFERENCE, Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.sampling.uniform import SIDES
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.supersample import supersample, supersample_pixels
from ..benchmarks.timing import timed
from ..file_kinds import COSTS
from .codes import SceneCodes
from .strategies import PatchNetwork

REFERENCE_SIDE = 32
_REFERENCE_PIXELS = 512  # pixels of a frame, enough for timing
CYCLES_MS_PER_PIXEL = 0.2
"""Processor milliseconds of 64 Cycles paths in a pixel, at the rate of camera renders in `patchnet bench bake`: 0.3
million paths per second."""


Costs = dict[str, Any]
"""Costs on one thread, plain JSON values: medians over frames of processor milliseconds.

ms_per_frame: by strategy. uniform_ms: of a picture with side x side rays in each pixel, by side. predicted_ms: of
predicted pictures by name. reference_ms_per_pixel: of 32x32 rays in a refined pixel.
"""


def measure_costs(
    codes: SceneCodes, cameras: Sequence[Camera], strategies: Mapping[str, Strategy], repeats: int
) -> Costs:
    """Measure frames by every strategy, in turns; strategies that read the reference have no cost."""
    names = predicted_names(list(codes.networks))
    times: dict[str, list[float]] = {}
    with limit_threads(1):
        for camera in cameras:
            runs = _runs(codes, camera, strategies)
            for run in runs.values():
                run()  # also compiles
            for key, seconds in timed(runs, repeats)[0].items():
                times.setdefault(key, []).append(1e3 * seconds)
    ms = {key: median(each) for key, each in times.items()}
    pixels = [len(_spread_pixels(camera)) for camera in cameras]
    references = zip(times["reference of pixels"], pixels, strict=True)
    return {
        "ms_per_frame": {name: ms[name] for name in strategies if name in ms},
        "uniform_ms": {str(side): ms[f"uniform {side}"] for side in SIDES},
        "predicted_ms": {name: ms[f"picture {name}"] for name in names},
        "reference_ms_per_pixel": median(each / count for each, count in references),
    }


def predicted_names(networks: Sequence[PatchNetwork]) -> list[str]:
    """Names of the predicted pictures: by the weights of the evaluation, then by each further network."""
    return [PREDICTED, *(f"{PREDICTED}-{network.name}" for network in networks)]


def _runs(codes: SceneCodes, camera: Camera, strategies: Mapping[str, Strategy]) -> dict[str, Callable[[], object]]:
    """Measured work of a frame by name: strategies; pictures; samples of the reference."""
    coded, octree = codes.coded, codes.coded.octree
    runs: dict[str, Callable[[], object]] = {}
    for name, strategy in strategies.items():
        if REFERENCE not in strategy.needs:
            runs[name] = partial(_rank, codes.of(strategy), camera, strategy)
    for side in SIDES:
        runs[f"uniform {side}"] = partial(_supersample, octree, camera, side)
    for name, by in zip(predicted_names(list(codes.networks)), [coded, *codes.networks.values()], strict=True):
        runs[f"picture {name}"] = partial(_predict, by, camera)
    pixels = _spread_pixels(camera)
    runs["reference of pixels"] = partial(supersample_pixels, octree, camera, pixels, REFERENCE_SIDE)
    return runs


def _rank(coded: CodedOctree, camera: Camera, strategy: Strategy) -> None:
    buffers = drain(trace_view(coded.octree, camera, [strategy], coded=coded, reference=False))
    refinement_order(buffers, strategy.scores(buffers))


def _supersample(octree: Octree, camera: Camera, side: int) -> None:
    drain(supersample(octree, camera, side))


def _predict(coded: CodedOctree, camera: Camera) -> None:
    buffers = drain(trace_view(coded.octree, camera, [], coded=coded, reference=False, unrefined=PREDICTED))
    assert buffers.predicted is not None  # computes the prediction


def _spread_pixels(camera: Camera) -> np.ndarray:
    """Pixels (N,) int64, evenly spread over the picture."""
    count = min(_REFERENCE_PIXELS, camera.pixel_count)
    return np.linspace(0, camera.pixel_count - 1, count).astype(np.int64)


def total_ms(values: Mapping[str, Any], strategy: str, ms_per_pixel: float) -> np.ndarray:
    """Milliseconds (B,) of a frame at each budget: the strategy's time and its budget's samples.

    values: of a scene in the results. ms_per_pixel: cost of the samples of a refined pixel.
    """
    pixels = values["active_pixels"] / max(values["frames"], 1)
    samples: np.ndarray = np.asarray(values["budgets"]) * pixels * ms_per_pixel
    return values["ms_per_frame"][strategy] + samples


def write_costs(costs: Costs, path: Path, key: str) -> None:
    """Write costs to a file. key: hash of all dependencies. Raises OutputError if it cannot be written."""
    with replaced_file(path, COSTS) as file:
        file.write(json.dumps({"key": key} | costs).encode())


def read_costs(path: Path, key: str) -> Costs | None:
    """Costs of `write_costs`; None if they are missing, damaged, or have another key."""
    try:
        kept: Costs = json.loads(path.read_text(encoding="utf-8"))
        return kept if kept["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
