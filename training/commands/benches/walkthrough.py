# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera fly-through of a static scene: the engine PatchNet, including its bake, against Cycles.

PatchNet bakes once and then renders each frame with its default samples; Cycles renders each frame with several numbers
of samples, denoised if its build can. PatchNet's rival is Cycles' cheapest picture with at most PatchNet's error.
Errors are against a ground truth of many samples. A few frames are rendered; the totals of all frames are extrapolated
from their medians, as the report states.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from statistics import fmean
from typing import Any

import bpy
import numpy as np

from ....commands.shared.engine import registered
from ....commands.shared.job_arguments import depth_of
from ....commands.shared.progress_lines import progress_lines
from ....commands.shared.quiet import quiet_stdout
from ....commands.shared.scene_argument import open_or_build
from ....operators.cycles.daylight import daylight, has_light
from ....operators.pipeline.lit_octree import build_lit_octree
from ....operators.render_engine.fly_through import frames_until_ahead
from ....operators.scene.cameras import choose_cameras
from ....operators.scene.read import read_scene
from ....operators.settings.job_settings import JobSettings
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.progress import Steps, drain
from ....patchnet_addon.runtime.stage_clock import StageClock
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.render import first_hits
from ....patchnet_addon.tracing.viewpoints import FOV, viewpoints
from ...benchmarks.timing import comparison
from ...evaluation.catalogue import SCENES
from ...evaluation.explorations import catmull_rom
from ...evaluation.poses import FreeSpace
from .walk_renders import Walk, walk

_PATH_DEPTH = 8  # of the octree for path finding
_VIEWS = 16  # candidates
_SKY = 0.02  # least open share of the sky, below which a place may be inside a hollow wall
_SKY_FOV, _SKY_PX = float(np.radians(120.0)), (32, 32)
_STEPS = 256  # sampled places along a way
_MOST = 0.6  # longest way, as a share of the surface's extent
_TURN = float(np.radians(20.0))  # left at the start, right at the end


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds and errors of both; raises PatchNetError, also for a missing scene file."""
    size = tuple(args.size)
    settings = JobSettings.of(depth=depth_of(args.depth), max_samples=args.max_samples, color=True, size=size)
    with quiet_stdout():
        open_scene_of(args.scene)
        with registered():
            cameras = walk_cameras(fly_through_keys(size), args.frames, size)
            lit = has_light(bpy.context.evaluated_depsgraph_get())
            with nullcontext() if lit else daylight(bpy.context.scene):
                found = drain(walk(bpy.context, settings, cameras, args), progress_lines())
    return _compared(args, found)


def open_scene_of(name: str) -> None:
    """Open a scene of the catalogue, a built-in scene, or a file."""
    open_or_build(str(SCENES[name].path()) if name in SCENES else name)


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


def _compared(args: argparse.Namespace, found: Walk) -> dict[str, Any]:
    ways = {"patchnet": found.ours, **{str(samples): each for samples, each in found.cycles.items()}}
    setup, cycles = sum(found.setup_s.values()), found.cycles
    # Cycles' cheapest picture with at most PatchNet's error; the most samples if none has.
    good = (samples for samples in sorted(cycles) if cycles[samples].mean_mse <= found.ours.mean_mse)
    rival = next(good, max(cycles))
    ours, peer = found.ours.frame_s, cycles[rival].frame_s
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
        "moved": {name: fmean(each.moved) if each.moved else None for name, each in ways.items()},
        "rival_samples": rival,
        "denoised": found.denoised,
        "ahead_from": frames_until_ahead(setup, ours, peer),
        "truth": args.truth,
        "error_size": list(args.error_size),
        "judged": len(found.ours.mse),
    }
    return comparison("walkthrough", ours, peer, details, "s per frame", higher_is_better=False)


def walk_keys(octree: Octree, size_px: tuple[int, int]) -> Steps[list[Camera]]:
    """Three cameras along the longest free horizontal way through a good view, looking ahead.

    Ways under the open sky are preferred, since without light a hall looks like a hollow wall. The first camera turns
    slightly left, the last slightly right. Raises SceneError without free space.
    """
    views = yield from viewpoints(octree, _VIEWS, size_px)
    space = FreeSpace(octree)
    ways = [_way(space, view) for view in views]
    lengths = np.array([float(np.linalg.norm(end - start)) for start, end in ways])
    under = np.array([_sky(octree, (start + end) / 2.0) > _SKY for start, end in ways])
    best = int(np.argmax(np.where(under | ~under.any(), lengths, -1.0)))
    (start, end), view = ways[best], views[best]
    heading = np.arctan2(view.forward[1], view.forward[0])
    keys = []
    for share, turn in ((0.0, _TURN), (0.5, 0.0), (1.0, -_TURN)):
        place = start + share * (end - start)
        ahead = np.array([np.cos(heading + turn), np.sin(heading + turn), view.forward[2]])
        keys.append(replace(Camera.look_at(place, place + ahead, fov=FOV, size_px=size_px), name="Walk"))
    return keys


def _sky(octree: Octree, place_world: np.ndarray) -> float:
    """Share of open sky above a place."""
    up = Camera.look_at(place_world, place_world + np.array([0.0, 1e-3, 1.0]), fov=_SKY_FOV, size_px=_SKY_PX)
    return float(1.0 - first_hits(octree, up).hit.mean())


def _level(view: Camera) -> np.ndarray:
    """Horizontal direction (3,) of a view."""
    forward = np.array([*np.asarray(view.forward)[:2], 0.0])
    return forward / max(float(np.linalg.norm(forward)), 1e-9)


def _way(space: FreeSpace, view: Camera) -> tuple[np.ndarray, np.ndarray]:
    """End points (3,) of the free way through a view's position, backward and forward, in world units."""
    low, high = space.bounds_world
    steps = np.linspace(0.0, _MOST * float((high - low).max()), _STEPS)[:, None]
    ends = []
    for way in (-_level(view), _level(view)):
        points = np.asarray(view.position_world) + steps * way
        free = space.contains(points) & ((points >= low) & (points < high)).all(axis=1)
        last = int(np.argmin(free)) - 1 if not free.all() else _STEPS - 1
        ends.append(points[max(last, 0)])
    return ends[0], ends[1]


def walk_cameras(keys: Sequence[Camera], frames: int, size: tuple[int, int]) -> list[Camera]:
    """Cameras at even intervals of time on a Catmull-Rom spline through the keys, with the lens of the first."""
    times = np.linspace(0.0, len(keys) - 1.0, frames)
    places = np.array([np.concatenate([key.position_world, np.asarray(key.forward)]) for key in keys])
    along = catmull_rom(np.arange(float(len(keys))), places, times)
    fov = 2.0 * np.arctan(keys[0].half_x * size[1] / size[0]) if size[0] > size[1] else 2.0 * np.arctan(keys[0].half_y)
    return [
        replace(
            Camera.look_at(spot[:3], spot[:3] + spot[3:], fov=fov, size_px=size, name="Walk"),
            clip_start=keys[0].clip_start,
            clip_end=keys[0].clip_end,
        )
        for spot in along
    ]
