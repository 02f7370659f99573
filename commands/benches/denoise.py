# SPDX-License-Identifier: GPL-3.0-or-later
"""Squared error of denoised light against the same light with its noise, and both against a bake of many paths.

Errors are of the luminance of texels, by region: smooth light, edges of shadows, contact shadows, textures. Both come
from the same paths. An error without denoising falls as the number of paths grows, which says how many more it takes.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from ..shared.job_arguments import require_blender
from .arguments import add_depth

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "the error of denoised light against light with its noise, by region"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench denoise`."""
    parser.add_argument("--scene", required=True, help="scene file; demo: the courtyard; room: a closed room")
    add_depth(parser)
    add_number(parser, "--samples", bounds.SAMPLES, default=4, help="paths per texel (4)")
    add_number(parser, "--reference-samples", bounds.SAMPLES, default=1024, help="paths of the reference (1024)")
    add_number(parser, "--texel-voxels", bounds.TEXEL_VOXELS, default=2.0, help="side of a texel in finest voxels (2)")


def measure(args: argparse.Namespace) -> Comparison:
    """Errors with and without denoising; raises PatchNetError."""
    require_blender()
    import bpy

    from ...operators.cycles.bake.bake import page_side
    from ...operators.cycles.daylight import has_light
    from ...operators.scene.read import read_scene
    from ...operators.settings.groups import LightSettings
    from ...patchnet_addon.lightmap.charts import layout_charts
    from ...patchnet_addon.lightmap.denoised_atlas import denoised_atlas
    from ...patchnet_addon.octree.grid import Grid
    from ...patchnet_addon.runtime.progress import drain
    from ...training.benchmarks.denoising import errors_by_region
    from ..shared.own_scenes import open_or_build
    from ..shared.progress_bars import ProgressBars
    from ..shared.quiet import quiet_stdout

    with quiet_stdout(), ProgressBars() as bars:
        open_or_build(args.scene)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        source = read_scene(depsgraph, "VISIBLE")
        texel = Grid.around(source.bounds_world, args.depth).voxel_size_world * args.texel_voxels
        light = LightSettings(samples=args.samples, daylight=not has_light(depsgraph))
        side = page_side(source.triangle_count)
        charts = drain(layout_charts(source, texel, samples=args.samples, page_side=side), bars.show)
        noisy = drain(_baked(bpy.context, source, charts, light, 1), bars.show)
        # On the same charts: which triangles share paths depends on how many there are.
        factor = max(round(args.reference_samples / args.samples), 1)
        charts = replace(charts, page_samples=charts.page_samples * factor)
        reference = drain(_baked(bpy.context, source, charts, light, 2), bars.show)
    denoised_atlas(noisy, source)  # compiles
    start = time.perf_counter()
    denoised = denoised_atlas(noisy, source)
    seconds = time.perf_counter() - start
    errors = errors_by_region(noisy, denoised, reference, source)
    return _compared(args, errors, seconds, int(noisy.charts.texel_count))


def _baked(context: Any, source: Any, charts: Any, light: Any, seed: int) -> Any:
    """Atlas of light with its noise on charts that are laid out."""
    import numpy as np

    from ...operators.cycles.bake.baker import Baker
    from ...patchnet_addon.lightmap.atlas import Atlas

    baker, pages = Baker(context, source, charts, light, seed=seed), []
    for page in range(charts.page_count):
        pages.append((yield from baker.page(page)))
    texels = np.concatenate(pages)
    return Atlas(charts, texels[:, :-1], light.samples, baker.warnings, noise=texels[:, -1])


def _compared(args: argparse.Namespace, errors: list[Any], seconds: float, texels: int) -> Comparison:
    from ...training.benchmarks.timing import Comparison

    whole = errors[0]
    details = {
        "scene": Path(args.scene).name,
        "depth": args.depth,
        "samples": args.samples,
        "reference_samples": args.reference_samples,
        "texels": texels,
        "seconds": seconds,
        "regions": [each.as_json() for each in errors],
        "samples_without": args.samples / whole.ratio if whole.ratio else None,
    }
    gain = whole.noisy / whole.denoised if whole.denoised else None
    return Comparison("denoise", whole.denoised, whole.noisy, gain, details, unit="mean squared error of luminance")


def text(values: dict[str, Any]) -> str:
    """Errors by region in a table."""
    from ...training.benchmarks.tables import markdown_table

    rows = [
        [
            each["region"], f"{each['share']:.0%}", f"{each['noisy']:.2e}", f"{each['denoised']:.2e}",
            f"{each['ratio']:.2f}", f"{each['reference_noise']:.1e}",
        ]
        for each in values["regions"]
    ]  # fmt: skip
    heads = ["region", "texels", "with noise", "denoised", "ratio", "noise of the reference"]
    more = values["samples_without"]
    return (
        f"{values['scene']} at depth {values['depth']}, {values['samples']} paths a texel against "
        f"{values['reference_samples']:,}: denoised in {values['seconds']:.1f} s\n\n{markdown_table(heads, rows)}\n\n"
        + (f"Without denoising, the same error over all takes {more:.0f} paths a texel" if more else "")
    )
