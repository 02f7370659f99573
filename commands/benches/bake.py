# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths per second of a bake against Cycles' camera renders of the same scene, page and render in turns.

Both are whole calls, reading the scene included, in processor seconds of all cores together. Renders take as many paths
as the page before them, from cameras that are placed in the scene. Beside that: how full the pages are, and how many
paths voxels get.
"""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from ..shared.job_arguments import require_blender
from .arguments import add_depth

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "the bake against camera renders: paths per second, filling of pages, paths per voxel"
_VIEWS = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench bake`."""
    parser.add_argument("--scene", default="room", help="scene file; demo: the courtyard; room: a closed room (room)")
    add_depth(parser, 7)
    add_number(parser, "--samples", bounds.SAMPLES, default=16, help="paths per texel (16)")
    add_number(parser, "--texel-voxels", bounds.TEXEL_VOXELS, default=2.0, help="side of a texel in finest voxels (2)")


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of both and the state of the pages; raises PatchNetError."""
    require_blender()
    import bpy

    from ...operators.cycles.daylight import daylight, has_light
    from ...operators.scene.read import read_scene
    from ...operators.verify_light.rates import measure_rates
    from ...patchnet_addon.network.weights import load_weights
    from ...patchnet_addon.octree.grid import Grid
    from ...patchnet_addon.runtime.progress import drain
    from ..shared.progress_bars import ProgressBars
    from ..shared.quiet import quiet_stdout
    from ..shared.scene_argument import open_or_build

    with quiet_stdout(), ProgressBars() as bars:
        open_or_build(args.scene)
        source = read_scene(bpy.context.evaluated_depsgraph_get(), "VISIBLE")
        grid = Grid.around(source.bounds_world, args.depth)
        lookahead = load_weights().lookahead
        charts, counts = drain(_laid_out(source, grid, args, lookahead), bars.show)
        cameras = drain(_cameras(source, grid), bars.show)
        lit = has_light(bpy.context.evaluated_depsgraph_get())
        with nullcontext() if lit else daylight(bpy.context.scene):
            rates = drain(measure_rates(bpy.context, source, charts, cameras), bars.show)
    result = _compared(Path(args.scene).name, args, source, charts, counts, rates)
    return replace(result, details={**result.details, "lookahead": lookahead})


def _laid_out(source: Any, grid: Any, args: argparse.Namespace, lookahead: int) -> Any:
    from ...operators.cycles.bake.bake import page_side
    from ...patchnet_addon.lightmap.charts import layout_charts
    from ...training.benchmarks.path_counts import path_counts

    texel = grid.voxel_size_world * args.texel_voxels
    side = page_side(source.triangle_count)
    charts = yield from layout_charts(source, texel, samples=args.samples, page_side=side)
    return charts, (yield from path_counts(source, charts, grid, lookahead=lookahead))


def _cameras(source: Any, grid: Any) -> Any:
    """Cameras in free space; the octree for it is a coarse one in plain light."""
    from ...patchnet_addon.octree.build import build_octree
    from ...patchnet_addon.surface.shading import two_lights_shade
    from ...patchnet_addon.tracing.viewpoints import viewpoints

    octree = yield from build_octree(source, replace(grid, depth=min(grid.depth, 8)), two_lights_shade(source))
    return (yield from viewpoints(octree, _VIEWS, (64, 64)))


def _compared(scene: str, args: argparse.Namespace, source: Any, charts: Any, counts: Any, rates: Any) -> Comparison:
    import numpy as np

    from ...operators.verify_light.rates import rate
    from ...training.benchmarks.path_counts import own_texels
    from ...training.benchmarks.timing import Comparison

    own, samples = own_texels(charts), charts.page_samples[charts.page]
    quantiles = {
        name: [float(value) for value in np.percentile(values, (5, 50))]
        for name, values in (("leaf", counts.leaf), ("stop", counts.stop))
    }
    details = {
        "scene": scene,
        "depth": args.depth,
        "samples": args.samples,
        "texel_voxels": args.texel_voxels,
        "triangles": source.triangle_count,
        "leaves": len(counts.leaf),
        "page_sizes": charts.page_size.tolist(),
        "page_samples": charts.page_samples.tolist(),
        "atlas_use": float(own.sum() / charts.page_size.prod(axis=1).sum()),
        "paths_a_side": int((own * samples).sum()),
        "paths_a_side_without_sharing": int(own.sum() * args.samples),
        "paths_5_and_50_percentile": quantiles,
        "pages": [asdict(turn) for turn in rates.pages],
        "renders": [asdict(turn) for turn in rates.renders],
        "clock": "processor",
    }
    ours, peer = rate(rates.pages) / 1e6, rate(rates.renders) / 1e6
    return Comparison("bake", ours, peer, ours / peer, details, unit="million paths per processor second")


def text(values: dict[str, Any]) -> str:
    """Rates, filling and paths in sentences and a table."""
    from ...training.benchmarks.tables import markdown_table

    percentiles = values["paths_5_and_50_percentile"]
    rows = [[name, f"{low:.1f}", f"{middle:.1f}"] for name, (low, middle) in percentiles.items()]
    table = markdown_table(["voxel", "5th percentile", "median"], rows)
    return (
        f"{values['scene']} at depth {values['depth']}: {values['triangles']:,} triangles, "
        f"{values['leaves']:,} leaves\n"
        f"Bake {values['ours']:.3f} million paths per processor second, camera renders {values['peer']:.3f}: ratio "
        f"{values['ratio']:.2f}\n"
        f"{values['atlas_use']:.0%} of texels on pages lie in a triangle\n"
        f"{values['paths_a_side'] / 1e6:.1f} M paths a side; if no triangles shared, "
        f"{values['paths_a_side_without_sharing'] / 1e6:.1f} M\n\n"
        f"Paths a side ({values['samples']} a texel of {values['texel_voxels']:g} leaves; stop: "
        f"{_levels(values['lookahead'])} above)\n\n"
        f"{table}"
    )


def _levels(lookahead: int) -> str:
    return {1: "one level", 2: "two levels", 3: "three levels"}[lookahead]
