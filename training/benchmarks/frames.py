# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of a whole frame, from camera to picture and priority, by stage; four rays in each pixel beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import median
from time import perf_counter
from typing import Any

import numba
import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.predict import predict
from ...patchnet_addon.image.heatmap import tint
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.ranking import rank
from ...patchnet_addon.sampling.registry import STRATEGIES
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import patch_hits
from ...patchnet_addon.tracing.supersample import supersample
from .timing import Comparison

STAGES = ("trace", "decode", "priority", "picture")
_BUDGET = 0.3
_UNIFORM_SIDE = 2  # rays a pixel side


def benchmark_frames(coded: CodedOctree, camera: Camera, repeats: int = 5, *, threads: int) -> Comparison:
    """Median wall seconds by stage, the first run left out; the peer is one picture of four rays in each pixel.

    Stages: rays with what is finer and behind, the network, score and order of all pixels, and the preview under the
    heatmap of what a budget of 30 % refines.
    """
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, before))
    try:
        runs = [_frame(coded, camera) for _ in range(repeats + 1)][1:]
    finally:
        numba.set_num_threads(before)
    seconds = {name: median(run[name] for run in runs) for name in runs[0]}
    ours = sum(seconds[name] for name in STAGES)
    details = {
        "view": camera.name,
        "size": [camera.width_px, camera.height_px],
        "threads": threads,
        "repeats": repeats,
        "stage_s": {name: seconds[name] for name in STAGES},
        "uniform_s": seconds["uniform"],
        "peer_name": f"{_UNIFORM_SIDE} x {_UNIFORM_SIDE} rays in each pixel",
    }
    return Comparison("frame", ours, seconds["uniform"], seconds["uniform"] / ours, details)


def _frame(coded: CodedOctree, camera: Camera) -> dict[str, float]:
    """Wall seconds of each stage of one frame."""
    clock = _Clock()
    traced = clock.time("trace", lambda: patch_hits(coded.octree, camera, lookahead=coded.weights.lookahead))
    prediction = clock.time("decode", lambda: predict(coded, traced.hits))
    buffers = PixelBuffers(traced.hits, behind=traced.behind, prediction=prediction)
    ranking = clock.time("priority", lambda: rank(STRATEGIES["patchnet-behind"], buffers, _BUDGET))
    count = int(np.count_nonzero(ranking.mask))
    clock.time("picture", lambda: tint(buffers.picture(buffers.preview), buffers.picture(ranking.urgency(count))))
    clock.time("uniform", lambda: drain(supersample(coded.octree, camera, _UNIFORM_SIDE)))
    return clock.seconds


class _Clock:
    """Wall seconds by name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def time(self, name: str, run: Callable[[], Any]) -> Any:
        start = perf_counter()
        result = run()
        self.seconds[name] = perf_counter() - start
        return result


def frame_rows(results: Sequence[Comparison]) -> list[dict[str, Any]]:
    """Plain JSON values of several frames."""
    return [result.as_json() for result in results]
