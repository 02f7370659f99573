# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk of a camera through a scene: the engine PatchNet, with its bake, against Cycles, frame by frame.

PatchNet bakes once and then renders each frame with its default budget; Cycles renders each frame anew, denoised where
its build can. Errors of both are against many samples. A few frames are rendered, and all of the walk extrapolated from
their medians: the text says so.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from statistics import fmean
from typing import Any

import bpy
import numpy as np

from ...operators import registration
from ...operators.cycles.daylight import daylight, has_light
from ...operators.pipeline.lit_octree import build_lit_octree
from ...operators.scene.cameras import choose_cameras
from ...operators.scene.read import read_scene
from ...operators.settings.job_settings import JobSettings
from ...operators.verify_light.walkthrough import Plan, Walk, walk, walk_cameras
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.stage_clock import StageClock
from ...patchnet_addon.tracing.camera import Camera
from ...training.benchmarks.tables import markdown_table
from ...training.benchmarks.timing import Comparison
from ...training.evaluation.catalogue import SCENES
from ..shared.job_arguments import depth_of
from ..shared.progress_bars import ProgressBars
from ..shared.quiet import quiet_stdout
from ..shared.scene_argument import open_or_build
from .walk_path import walk_keys

_PATH_DEPTH = 7  # of the voxels between which the way is found


def measure(args: argparse.Namespace) -> Comparison:
    """Seconds and errors of both; raises PatchNetError, as where a scene of the catalogue is not there."""
    size = tuple(args.size)
    settings = JobSettings.of(
        depth=depth_of(args.depth), fit=args.depth == "fit", samples=args.samples, color=True, size=size,
        network_device=args.device,
    )  # fmt: skip
    with quiet_stdout(), ProgressBars() as bars:
        open_or_build(str(SCENES[args.scene].path()) if args.scene in SCENES else args.scene)
        with _registered():
            cameras = walk_cameras(_keys(size), args.frames, size)
            timed, cycles, judged = (_spread(args.frames, n) for n in (args.timed, args.cycles_timed, args.judged))
            plan = Plan(cameras, timed, cycles, judged, tuple(args.error_size), args.cycles_samples, args.truth)
            lit = has_light(bpy.context.evaluated_depsgraph_get())
            with nullcontext() if lit else daylight(bpy.context.scene):
                found = drain(walk(bpy.context, settings, plan), bars.show)
    return _compared(args, found)


@contextmanager
def _registered() -> Iterator[None]:
    """Block in which Blender knows the render engine."""
    known = hasattr(bpy.types.Scene, "patchnet")
    if not known:
        registration.register()
    try:
        yield
    finally:
        if not known:
            registration.unregister()


def _keys(size: tuple[int, int]) -> list[Camera]:
    """Cameras that the walk passes: the scene's own from far to near, or a straight way through its free space."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    if sum(item.type == "CAMERA" for item in bpy.context.scene.objects) < 2:
        settings = JobSettings.of(depth=_PATH_DEPTH, light="two-lights")
        return drain(walk_keys(drain(build_lit_octree(bpy.context, settings, StageClock())).octree, size))
    surface = read_scene(depsgraph, "VISIBLE").bounds_world
    cameras = choose_cameras(depsgraph, ("all",), size, surface)
    middle = surface.mean(axis=0)
    return sorted(cameras, key=lambda camera: -float(np.linalg.norm(np.asarray(camera.position_world) - middle)))


def _spread(frames: int, count: int) -> list[int]:
    """Frames in the middles of `count` even parts of the walk."""
    count = min(count, frames)
    return [int((index + 0.5) * frames / count) for index in range(count)]


def _compared(args: argparse.Namespace, found: Walk) -> Comparison:
    ours, peer = found.frame_s
    setup = sum(found.setup_s.values())
    details = {
        "scene": args.scene,
        "frames": args.frames,
        "size": list(args.size),
        "depth": found.depth,
        "device": args.device,
        "leaves": found.leaves,
        "setup_s": found.setup_s,
        "frames_s": {"patchnet": found.ours_s, "cycles": found.cycles_s},
        "total_s": {"patchnet": setup + args.frames * ours, "cycles": args.frames * peer},
        "cycles_samples": args.cycles_samples,
        "denoised": found.denoised,
        "ahead_from": found.ahead_from,
        "truth": args.truth,
        "error_size": list(args.error_size),
        "mse": {"patchnet": fmean(found.ours_mse), "cycles": fmean(found.cycles_mse)},
        "judged": len(found.ours_mse),
    }
    return Comparison("walkthrough", ours, peer, peer / ours, details, unit="s per frame")


def text(values: dict[str, Any]) -> str:
    """Figures of both in a table, and what they mean for a walk."""
    setup, frames = sum(values["setup_s"].values()), values["frames"]
    counts = [len(values["frames_s"][name]) for name in ("patchnet", "cycles")]
    cycles = f"Cycles, {values['cycles_samples']} samples{', denoised' if values['denoised'] else ''}"
    rows = [
        [name, f"{once:.1f}", f"{frame:.2f}", f"{values['total_s'][key]:.0f}", f"{1e4 * values['mse'][key]:.1f}"]
        for name, key, once, frame in (
            ("PatchNet", "patchnet", setup, values["ours"]), (cycles, "cycles", 0.0, values["peer"]),
        )
    ]  # fmt: skip
    ahead = values["ahead_from"]
    stages = ", ".join(f"{name} {seconds:.1f}" for name, seconds in values["setup_s"].items())
    end = "PatchNet is never ahead" if ahead is None else f"PatchNet is ahead from {ahead} frames on"
    return (
        f"{values['scene']}, {frames} frames of {values['size'][0]} x {values['size'][1]}; depth {values['depth']}, "
        f"{values['leaves']:,} voxels ({stages} s)\n\n"
        + markdown_table(["", "once, s", "a frame, s", f"{frames} frames, s", "mse x 10,000"], rows)
        + f"\n\n{end}; afterwards {values['ratio']:.1f} times as fast a frame.\n"
        f"Frames: medians of {counts[0]} and {counts[1]} that were rendered; totals are extrapolated from these. "
        f"Errors: all light, gloss included, of {values['judged']} frames of {values['error_size'][0]} x "
        f"{values['error_size'][1]} against {values['truth']:,} samples."
    )
