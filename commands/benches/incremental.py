# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake of a scene after one of its objects moved: incremental against whole, wall seconds of the light alone.

Both start from the same scene. What the incremental bake leaves as it was is compared with the whole one: noise of
single triangles is left out by means over a large surface.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from ..shared.job_arguments import require_blender
from .arguments import add_depth

if TYPE_CHECKING:
    import numpy as np

    from ...training.benchmarks.timing import Comparison

_WHITE = 0.995  # quantile of luminance by area, as of the automatic exposure (methods 7.1)


class _Light(NamedTuple):
    """Light of a surface by triangle: luminance (T,) before exposure, and area (T,)."""

    luminance: np.ndarray
    area: np.ndarray


HELP = "a bake after one object moved, incremental against whole"
_CHAIR = "Chair"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench incremental`."""
    parser.add_argument("--scene", default="demo", help="scene file; demo: the courtyard; room: a closed room (demo)")
    add_depth(parser)
    parser.add_argument("--object", default=_CHAIR, help=f"object that moves ({_CHAIR})")
    where, axes = (0.4, 0.0, 0.0), ("X", "Y", "Z")
    add_number(parser, "--move", bounds.COORDINATE, nargs=3, metavar=axes, default=where, help="how far (0.4 0 0)")
    add_number(parser, "--samples", bounds.SAMPLES, default=4, help="paths per texel (4)")
    add_number(parser, "--tolerance", bounds.TOLERANCE, default=0.05, help="of the incremental bake (0.05)")


def measure(args: argparse.Namespace) -> Comparison:
    """Seconds of both, and what stays; raises PatchNetError."""
    require_blender()
    import bpy

    from ...operators.cycles.daylight import daylight, has_light
    from ...patchnet_addon.runtime.errors import SceneError
    from ...training.benchmarks.timing import Comparison
    from ..shared.own_scenes import open_or_build
    from ..shared.progress_bars import ProgressBars
    from ..shared.quiet import quiet_stdout

    with quiet_stdout(), ProgressBars() as bars, _empty_cache():
        open_or_build(args.scene)
        moved = bpy.context.scene.objects.get(args.object)
        if moved is None:
            raise SceneError(f"The scene has no object '{args.object}': name one of its objects with --object")
        lit = has_light(bpy.context.evaluated_depsgraph_get())
        with nullcontext() if lit else daylight(bpy.context.scene):
            _, before, _ = _bake(args, bars, incremental=True)
            for axis, step in enumerate(args.move):
                moved.location[axis] += step
            bpy.context.view_layer.update()
            ours, after, notes = _bake(args, bars, incremental=True)
            peer, whole, _ = _bake(args, bars, incremental=False)
    details = {
        "scene": args.scene,
        "depth": args.depth,
        "object": args.object,
        "move": list(args.move),
        "samples": args.samples,
        **notes,
        "stays_brighter_by": _brighter_by(before, after, whole),
    }
    return Comparison("incremental", ours, peer, peer / ours, details)


def _bake(args: argparse.Namespace, bars: Any, *, incremental: bool) -> tuple[float, _Light, dict[str, Any]]:
    """Seconds, light and notes of a bake of the scene as it is now."""
    import bpy
    import numpy as np

    from ...operators.cycles.bake.bake import bake_luminance
    from ...operators.scene.read import read_scene
    from ...operators.settings.groups import LightSettings
    from ...patchnet_addon.lightmap.chart_lookup import triangle_means
    from ...patchnet_addon.octree.grid import Grid
    from ...patchnet_addon.octree.voxelize import triangle_areas_and_normals
    from ...patchnet_addon.runtime.progress import drain

    source = read_scene(bpy.context.evaluated_depsgraph_get(), "VISIBLE")
    texel = 2.0 * Grid.around(source.bounds_world, args.depth).voxel_size_world
    light = LightSettings(samples=args.samples, incremental=incremental, tolerance=args.tolerance)
    start = time.perf_counter()
    atlas = drain(bake_luminance(bpy.context, source, texel, light), bars.show)
    seconds = time.perf_counter() - start
    areas = np.concatenate([triangle_areas_and_normals(batch.corners_world)[0] for batch in source.batches()])
    means = triangle_means(atlas.charts, atlas.texels, np.arange(source.triangle_count))[:, 0]
    return seconds, _Light(means, areas), dict(atlas.notes.get("incremental", {}))


def _brighter_by(before: _Light, after: _Light, whole: _Light) -> float:
    """Mean of incremental - whole where the incremental bake left the light as it was, as a share of white."""
    import numpy as np

    stays = before.luminance == after.luminance
    order = np.argsort(whole.luminance)
    share = np.cumsum(whole.area[order]) / whole.area.sum()
    white = float(whole.luminance[order[np.searchsorted(share, _WHITE)]])
    brighter = (after.luminance - whole.luminance)[stays]
    return float(np.average(brighter, weights=whole.area[stays]) / white) if stays.any() else 0.0


@contextmanager
def _empty_cache() -> Iterator[None]:
    """Keep the light of bakes in a folder of this run: an earlier run's would make the first bake incremental, too."""
    from ...patchnet_addon.runtime import kernels

    assert kernels  # compiled ones stay where they are, since that is imported
    before = os.environ.get("PATCHNET_CACHE")
    with TemporaryDirectory() as folder:
        os.environ["PATCHNET_CACHE"] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ["PATCHNET_CACHE"]
            else:
                os.environ["PATCHNET_CACHE"] = before


def text(values: dict[str, Any]) -> str:
    """Seconds and shares in sentences."""
    move = " ".join(f"{step:g}" for step in values["move"])
    return (
        f"{values['scene']} at depth {values['depth']}, {values['samples']} samples; "
        f"{values['object']} moved by {move}\n"
        f"Incremental bake, tolerance {values['tolerance']:g}: {values['ours']:.1f} s, "
        f"{values['texels_baked']:.0%} of texels, {values['triangles_baked'] / values['triangles']:.0%} of triangles\n"
        f"Whole bake: {values['peer']:.1f} s, ratio {values['ratio']:.2f}\n"
        f"What stays is {values['stays_brighter_by']:+.5f} of white brighter than in the whole bake, in the mean"
    )
