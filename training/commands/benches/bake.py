# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths per second of a bake against Cycles' camera renders of the same scene, in turns.

Both are whole calls, including scene reading, in processor seconds of all cores. A render takes as many paths as the
call before it, from the cameras that the bake is for, which are placed in the scene.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np

from ....commands.shared.progress_lines import progress_lines
from ....commands.shared.quiet import quiet_stdout
from ....commands.shared.scene_argument import open_or_build
from ....operators.cycles.bake.bake_job import BakeJob, begin
from ....operators.cycles.bake.baker import SurfelBaker
from ....operators.cycles.daylight import daylight, has_light
from ....operators.cycles.scene_copy import prepared
from ....operators.scene.read import read_scene
from ....operators.settings.groups import LightSettings
from ....patchnet_addon.lod.depth import coarse_octree
from ....patchnet_addon.octree.grid import Grid
from ....patchnet_addon.octree.voxelize import ClippedSurface
from ....patchnet_addon.process.transfer import Remote
from ....patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ....patchnet_addon.runtime.progress import Progress, Steps, drain
from ....patchnet_addon.tracing.viewpoints import viewpoints
from ...benchmarks.timing import comparison

_VIEWS = 8
_MIN_PX, _MAX_PX = 16, 2048
_SIZE_PX = (256, 256)  # of the cameras that the bake is for
_TURNS = 4


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Rates of bake and renders; raises PatchNetError."""
    show = progress_lines()
    with quiet_stdout():
        open_or_build(args.scene)
        source = read_scene(bpy.context.evaluated_depsgraph_get(), "VISIBLE")
        # In free space, found in a coarse octree.
        coarse = drain(coarse_octree(source, min(args.depth, 8)), show)
        cameras = drain(viewpoints(coarse, _VIEWS, _SIZE_PX, lit=False), show)
        lit = has_light(bpy.context.evaluated_depsgraph_get())
        light = LightSettings(color=False, daylight=not lit)
        grid = Grid.around(source.bounds_world, args.depth)
        clipped = Remote(ClippedSurface(source, grid))
        job = BakeJob(bpy.context, source, clipped, grid, tuple(cameras), light, DEFAULT_LOOKAHEAD)
        surfels = drain(begin(job), show).bake.value.chosen.surfels
        with nullcontext() if lit else daylight(bpy.context.scene):
            calls, renders = drain(_measured(job, surfels, args.samples), show)
    details = {
        "scene": Path(args.scene).name,
        "depth": args.depth,
        "samples": args.samples,
        "triangles": source.triangle_count,
        "surfels": len(surfels),
        "calls": [turn._asdict() for turn in calls],
        "renders": [turn._asdict() for turn in renders],
        "clock": "processor",
    }
    ours, peer = rate(calls) / 1e6, rate(renders) / 1e6
    return comparison("bake", ours, peer, details, "million paths per processor second")


class Turn(NamedTuple):
    """Bake call or rendered picture: paths, and processor seconds of the whole call."""

    paths: int
    processor_s: float


def rate(turns: Sequence[Turn]) -> float:
    """Paths per processor second of all cores, which other programs' load affects least."""
    return sum(turn.paths for turn in turns) / sum(turn.processor_s for turn in turns)


def _measured(job: BakeJob, surfels: np.ndarray, samples: int) -> Steps[tuple[list[Turn], list[Turn]]]:
    """Bake equal parts of the surfels, and render about as many paths through the next camera after each."""
    baker = SurfelBaker(job.context, job.source, job.light, job.grid.side_world)
    calls: list[Turn] = []
    renders: list[Turn] = []
    for turn, part in enumerate(np.array_split(surfels, _TURNS)):
        at = Progress(turn, _TURNS, "Measuring")
        yield at
        before = baker.paths_traced
        baked = _timed(partial(drain, baker.bake(part, samples, turn, at)))
        calls.append(Turn(baker.paths_traced - before, baked))
        side = int(np.clip(round(float(np.sqrt(calls[-1].paths / samples))), _MIN_PX, _MAX_PX))
        camera = job.cameras[turn % len(job.cameras)].with_size(side, side)
        with prepared(job.context, camera, samples, turn, Path()) as (scene, _):
            rendered = _timed(partial(bpy.ops.render.render, scene=scene.name))
            renders.append(Turn(camera.pixel_count * samples, rendered))
    return calls, renders


def _timed(run: Callable[[], object]) -> float:
    """Processor seconds of a call."""
    before = time.process_time()
    run()
    return time.process_time() - before
