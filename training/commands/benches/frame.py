# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of a whole frame, from camera to picture and priority, by stage; beside it, four rays in each pixel.

Stages: rays with finer voxels and voxels behind, the network, score and order of all pixels, and the preview with the
heatmap of a budget of 30 %.
"""

from __future__ import annotations

import argparse
from statistics import median
from typing import Any

import numpy as np

from ....commands.shared.views import view_cameras
from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.codes.encode import encode_octree
from ....patchnet_addon.codes.predict import predict
from ....patchnet_addon.image.heatmap import tint
from ....patchnet_addon.network.weights import load_weights
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.stage_clock import StageClock
from ....patchnet_addon.runtime.threads import limit_threads, usable_cores
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.ranking import rank
from ....patchnet_addon.sampling.registry import STRATEGIES
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.render import first_hits
from ....patchnet_addon.tracing.supersample import behind_patches, supersample
from ...benchmarks.timing import comparison
from .inputs import given_octree
from .trace import views_of

STAGES = ("trace", "decode", "priority", "picture")
_BUDGET = 0.3
_UNIFORM_SIDE = 2  # rays per pixel side


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Median wall seconds of each view by stage, without the first run; raises PatchNetError."""
    octree, name = given_octree(args)
    coded = drain(encode_octree(octree, load_weights()))
    cameras = view_cameras(args) if args.view else views_of(octree, tuple(args.size))
    threads = args.threads or usable_cores()
    with limit_threads(threads):
        frames = [_measured(coded, camera, args.repeats) for camera in cameras]
    details = {
        "octree": name,
        "depth": octree.depth,
        "size": list(args.size),
        "threads": threads,
        "repeats": args.repeats,
        "peer_name": f"{_UNIFORM_SIDE} x {_UNIFORM_SIDE} rays in each pixel",
        "frames": frames,
    }
    ours, peer = frames[0]["ours"], frames[0]["peer"]
    return comparison("frame", ours, peer, details, "s", higher_is_better=False)


def _measured(coded: CodedOctree, camera: Camera, repeats: int) -> dict[str, Any]:
    runs = [_frame(coded, camera) for _ in range(repeats + 1)][1:]
    seconds = {name: median(run[name] for run in runs) for name in runs[0]}
    stages = {name: seconds[name] for name in STAGES}
    return {"view": camera.name, "stage_s": stages, "ours": sum(stages.values()), "peer": seconds["uniform"]}


def _frame(coded: CodedOctree, camera: Camera) -> dict[str, float]:
    """Wall seconds of each stage of one frame."""
    clock = StageClock()
    with clock.stage("trace"):
        hits = first_hits(coded.octree, camera)
        behind = behind_patches(coded.octree, camera, hits, lookahead=coded.weights.lookahead)
    with clock.stage("decode"):
        prediction = predict(coded, hits)
    buffers = PixelBuffers(hits, behind=behind.luminance, prediction=prediction)
    with clock.stage("priority"):
        ranking = rank(STRATEGIES["patchnet-behind"], buffers, _BUDGET)
    with clock.stage("picture"):
        refined = int(np.count_nonzero(ranking.mask))
        tint(buffers.picture(buffers.preview), buffers.picture(ranking.urgency(refined)))
    with clock.stage("uniform"):
        drain(supersample(coded.octree, camera, _UNIFORM_SIDE))
    return clock.seconds
