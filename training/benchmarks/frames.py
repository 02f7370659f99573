# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of a whole frame, from camera to picture and priority, by stage; four rays in each pixel beside it."""

from __future__ import annotations

from statistics import median

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.predict import predict
from ...patchnet_addon.image.heatmap import tint
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.stage_clock import StageClock
from ...patchnet_addon.runtime.threads import limit_threads
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
    with limit_threads(threads):
        runs = [_frame(coded, camera) for _ in range(repeats + 1)][1:]
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
    clock = StageClock()
    with clock.stage("trace"):
        traced = patch_hits(coded.octree, camera, lookahead=coded.weights.lookahead)
    with clock.stage("decode"):
        prediction = predict(coded, traced.hits)
    buffers = PixelBuffers(traced.hits, behind=traced.behind, prediction=prediction)
    with clock.stage("priority"):
        ranking = rank(STRATEGIES["patchnet-behind"], buffers, _BUDGET)
    with clock.stage("picture"):
        refined = int(np.count_nonzero(ranking.mask))
        tint(buffers.picture(buffers.preview), buffers.picture(ranking.urgency(refined)))
    with clock.stage("uniform"):
        drain(supersample(coded.octree, camera, _UNIFORM_SIDE))
    return clock.seconds
