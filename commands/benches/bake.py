# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths per second of a bake against Cycles' camera renders of the same scene, in turns.

Both are whole calls, including scene reading, in processor seconds of all cores. A render takes as many paths as the
page before it, from cameras placed in the scene. The report also has the occupancy of the pages.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np

from ...operators.cycles.bake.bake import page_side
from ...operators.cycles.bake.baker import Baker, lift_world
from ...operators.cycles.bake.two_sided_surfaces import plan_sides
from ...operators.cycles.daylight import daylight, has_light
from ...operators.cycles.scene_copy import prepared
from ...operators.scene.read import read_scene
from ...operators.scene.scene_mesh import SceneMesh
from ...operators.settings.groups import LightSettings
from ...patchnet_addon.lightmap.chart_lookup import texel_owners
from ...patchnet_addon.lightmap.charts import Charts, layout_charts
from ...patchnet_addon.octree.build import build_octree
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.interrupt import interrupts_wait
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.surface.shading import two_lights_shade
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.viewpoints import viewpoints
from ...training.benchmarks.timing import comparison
from ..shared.progress_bars import ProgressBars
from ..shared.quiet import quiet_stdout
from ..shared.scene_argument import open_or_build

_VIEWS = 8
_MIN_PX, _MAX_PX = 64, 2048


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Rates of bake and renders, and occupancy of the pages; raises PatchNetError."""
    with quiet_stdout(), ProgressBars() as bars:
        open_or_build(args.scene)
        source = read_scene(bpy.context.evaluated_depsgraph_get(), "VISIBLE")
        grid = Grid.around(source.bounds_world, args.depth)
        texel, side = grid.voxel_size_world * args.texel_voxels, page_side(source.triangle_count)
        charts = drain(layout_charts(source, texel, samples=args.samples, page_side=side), bars.show)
        # In free space, found in a coarse octree with plain light.
        steps = build_octree(source, replace(grid, depth=min(grid.depth, 8)), two_lights_shade(source))
        cameras = drain(viewpoints(drain(steps, bars.show), _VIEWS, (64, 64)), bars.show)
        lit = has_light(bpy.context.evaluated_depsgraph_get())
        with nullcontext() if lit else daylight(bpy.context.scene):
            pages, renders = drain(_measured(bpy.context, source, charts, cameras), bars.show)
    own = own_texels(charts)
    details = {
        "scene": Path(args.scene).name,
        "depth": args.depth,
        "samples": args.samples,
        "texel_voxels": args.texel_voxels,
        "triangles": source.triangle_count,
        "atlas_use": float(own.sum() / charts.page_size.prod(axis=1).sum()),
        "paths_a_side": int((own * charts.page_samples[charts.page]).sum()),
        "pages": [turn._asdict() for turn in pages],
        "renders": [turn._asdict() for turn in renders],
        "clock": "processor",
    }
    ours, peer = rate(pages) / 1e6, rate(renders) / 1e6
    return comparison("bake", ours, peer, details, "million paths per processor second")


def own_texels(charts: Charts) -> np.ndarray:
    """Number of texels of each triangle, (T,) int64."""
    owners = np.concatenate([texel_owners(charts, page).ravel() for page in range(charts.page_count)])
    return np.bincount(owners[owners >= 0], minlength=len(charts.page))


class Turn(NamedTuple):
    """Baked page or rendered picture: paths, and processor seconds of the whole call."""

    paths: int
    processor_s: float


def rate(turns: Sequence[Turn]) -> float:
    """Paths per processor second of all cores, which other programs' load affects least."""
    return sum(turn.paths for turn in turns) / sum(turn.processor_s for turn in turns)


def _measured(
    context: bpy.types.Context, source: SceneMesh, charts: Charts, cameras: Sequence[Camera]
) -> Steps[tuple[list[Turn], list[Turn]]]:
    """Bake each page that is not empty, and render about as many paths through the next camera."""
    light = LightSettings(color=False)
    plan = yield from plan_sides(context, source, cameras, light, lift_world(source, charts))
    baker = Baker(context, source, charts, light, plan)
    pages: list[Turn] = []
    renders: list[Turn] = []
    for page in range(charts.page_count):
        yield Progress(page, charts.page_count, "Measuring")
        baked = _timed(partial(drain, baker.page(page)))
        if not baker.paths_traced:
            continue
        pages.append(Turn(baker.paths_traced, baked))
        samples = int(charts.page_samples[page])
        side = int(np.clip(round(float(np.sqrt(baker.paths_traced / samples))), _MIN_PX, _MAX_PX))
        camera = cameras[len(renders) % len(cameras)].with_size(side, side)
        with prepared(context, camera, samples, page, Path()) as (scene, _):
            with interrupts_wait():
                rendered = _timed(partial(bpy.ops.render.render, scene=scene.name))
            renders.append(Turn(camera.pixel_count * samples, rendered))
    return pages, renders


def _timed(run: Callable[[], object]) -> float:
    """Processor seconds of a call."""
    before = time.process_time()
    run()
    return time.process_time() - before
