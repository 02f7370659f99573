# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera fly-through of a static scene: the engine PatchNet, including its bake, against Cycles.

PatchNet bakes once and then renders each frame with its default samples; Cycles renders each frame with several numbers
of samples, denoised if its build can. PatchNet's rival is Cycles' cheapest picture with at most PatchNet's error.
Errors are against a ground truth of many samples. A few frames are rendered; the totals of all frames are extrapolated
from their medians, as the report states.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from statistics import fmean

import bpy
import numpy as np

from ...operators import registration
from ...operators.cycles.daylight import daylight, has_light
from ...operators.pipeline.lit_octree import build_lit_octree
from ...operators.scene.cameras import choose_cameras
from ...operators.scene.read import read_scene
from ...operators.settings.job_settings import JobSettings
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.stage_clock import StageClock
from ...patchnet_addon.tracing.camera import Camera
from ...training.benchmarks.timing import Comparison
from ...training.evaluation.catalogue import SCENES
from ..shared.job_arguments import depth_of
from ..shared.progress_bars import ProgressBars
from ..shared.quiet import quiet_stdout
from ..shared.scene_argument import open_or_build
from .walk_path import walk_cameras, walk_keys
from .walk_renders import Plan, Walk, walk

_PATH_DEPTH = 8  # of the octree for path finding


def measure(args: argparse.Namespace) -> Comparison:
    """Seconds and errors of both; raises PatchNetError, also for a missing scene file."""
    size = tuple(args.size)
    settings = JobSettings.of(
        depth=depth_of(args.depth), fit=args.depth == "fit", samples=args.samples, color=True, size=size
    )
    with quiet_stdout(), ProgressBars() as bars:
        open_scene_of(args.scene)
        with _registered():
            cameras = walk_cameras(fly_through_keys(size), args.frames, size)
            timed, cycles = (_spread(args.frames, count) for count in (args.timed, args.cycles_timed))
            judged = _spread(max(args.frames - 1, 1), args.judged)  # each with the next frame
            samples = sorted(set(args.cycles_samples))
            plan = Plan(cameras, timed, cycles, judged, tuple(args.error_size), samples, args.truth)
            lit = has_light(bpy.context.evaluated_depsgraph_get())
            with nullcontext() if lit else daylight(bpy.context.scene):
                found = drain(walk(bpy.context, settings, plan), bars.show)
    return _compared(args, found)


def open_scene_of(name: str) -> None:
    """Open a scene of the catalogue, a built-in scene, or a file."""
    open_or_build(str(SCENES[name].path()) if name in SCENES else name)


@contextmanager
def _registered() -> Iterator[None]:
    """Register the render engine within the block."""
    known = hasattr(bpy.types.Scene, "patchnet")
    if not known:
        registration.register()
    try:
        yield
    finally:
        if not known:
            registration.unregister()


def fly_through_keys(size: tuple[int, int]) -> list[Camera]:
    """Key cameras: the scene's own from far to near, or a straight way through its free space."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    if sum(item.type == "CAMERA" for item in bpy.context.scene.objects) < 2:
        settings = JobSettings.of(depth=_PATH_DEPTH, light="two-lights")
        return drain(walk_keys(drain(build_lit_octree(bpy.context, settings, StageClock())).octree, size))
    surface = read_scene(depsgraph, "VISIBLE").bounds_world
    cameras = choose_cameras(depsgraph, ("all",), size, surface)
    middle = surface.mean(axis=0)
    return sorted(cameras, key=lambda camera: -float(np.linalg.norm(np.asarray(camera.position_world) - middle)))


def _spread(frames: int, count: int) -> list[int]:
    """Frames in the middles of `count` equal parts of the fly-through."""
    count = min(count, frames)
    return [int((index + 0.5) * frames / count) for index in range(count)]


def _compared(args: argparse.Namespace, found: Walk) -> Comparison:
    ways = {"patchnet": found.ours, **{str(samples): each for samples, each in found.cycles.items()}}
    setup, rival = sum(found.setup_s.values()), found.cycles[found.rival]
    details = {
        "scene": args.scene,
        "frames": args.frames,
        "size": list(args.size),
        "depth": found.depth,
        "leaves": found.leaves,
        "setup_s": found.setup_s,
        "frames_s": {name: each.seconds for name, each in ways.items()},
        "total_s": {
            name: args.frames * each.frame_s + (setup if each is found.ours else 0.0) for name, each in ways.items()
        },
        "mse": {name: each.mean_mse for name, each in ways.items()},
        "flicker": {name: fmean(each.flicker) if each.flicker else None for name, each in ways.items()},
        "rival_samples": found.rival,
        "denoised": found.denoised,
        "ahead_from": found.ahead_from,
        "truth": args.truth,
        "error_size": list(args.error_size),
        "judged": len(found.ours.mse),
    }
    ours, peer = found.ours.frame_s, rival.frame_s
    return Comparison("walkthrough", ours, peer, peer / ours, details, unit="s per frame")
