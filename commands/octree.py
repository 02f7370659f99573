# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet octree SCENE`: the lit octree of a scene alone, as training needs it."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..patchnet_addon.runtime import bounds
from ..patchnet_addon.runtime.errors import SettingError
from .shared.arguments import add_number, add_out
from .shared.frames import add_frames, bake_with_bars, check_frames, print_frames
from .shared.job_arguments import add_both_sides, add_color, add_exposure, require_blender
from .shared.lines import make_parent, say_note, say_result
from .shared.quiet import quiet_stdout
from .shared.scene_argument import add_scene, open_given, scene_path
from .shared.stage_clock import StageClock
from .shared.views import add_views, say_unseen, view_cameras

if TYPE_CHECKING:
    from ..patchnet_addon.lightmap.page_cache import KeptPages
    from ..patchnet_addon.octree.grid import Grid
    from ..patchnet_addon.octree.leaf_levels import LeafLevels
    from ..patchnet_addon.octree.octree import Octree
    from ..patchnet_addon.runtime.progress import Steps
    from ..patchnet_addon.surface.mesh import MeshSource, Shade

FIT = "fit"


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:  # type: ignore[type-arg]
    """Arguments of `patchnet octree`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "octree",
        help="voxelize and light a scene",
        description="Write the lit octree of a scene, upright or turned, for training and experiments.",
    )
    add_scene(parser, "scene file, as for `patchnet run`")
    parser.add_argument("--depth", required=True, help="octree depth, or fit: fine only where the views look")
    add_views(parser)
    parser.add_argument("--light", choices=("cycles", "two-lights"), default="cycles", help="light (cycles)")
    add_number(parser, "--samples", bounds.SAMPLES, default=8, help="Cycles samples per baked texel (8)")
    add_number(
        parser, "--texel-voxels", bounds.TEXEL_VOXELS, default=2.0, help="side of a baked texel in leaf voxels (2)"
    )
    add_exposure(parser)
    add_color(parser)
    add_both_sides(parser)
    add_number(
        parser, "--rotate", bounds.SEED, default=0, metavar="SEED",
        help="turn the lit surface by a random rotation; two-lights then shines from a random direction (0: upright)",
    )  # fmt: skip
    parser.add_argument(
        "--without", default="", metavar="TEXT,TEXT", help="leave out objects below a name with one of these texts"
    )
    add_frames(parser)
    add_out(parser, "octree file to write; with --frames, a folder", required=True)
    parser.add_argument(
        "--timings", action="store_true", help="end with a line of JSON: seconds and peak memory of each stage"
    )
    parser.set_defaults(bounds=None, daylight=None)  # what frames have in common, see octree_frames
    return parser


def run(args: argparse.Namespace) -> int:
    """Build the octree and write it; returns 0; raises PatchNetError."""
    _check(args)
    clock = StageClock()
    with clock.stage("start"):
        require_blender()
    from ..patchnet_addon.lightmap.page_cache import KeptPages
    from ..patchnet_addon.octree.file import save_octree
    from ..patchnet_addon.runtime.progress import drain
    from .shared.progress_bars import ProgressBars

    check_out(args)
    with clock.stage("open"):
        open_given(args.scene)
    check_out(args)
    hide_from_renders(without(args))
    if args.frames is not None:
        from .octree_frames import OctreeMaker

        print_frames(bake_with_bars(args, OctreeMaker(args, clock), args.out), args.out)
        return 0
    make_parent(args.out)
    with KeptPages() as kept:
        with quiet_stdout(), ProgressBars() as bars:
            octree = drain(build(args, clock, kept), bars.show)
        with clock.stage("save"):
            save_octree(octree, args.out)
    text = f"{args.out}: depth {octree.depth}, {octree.leaf_count:,} voxels, {octree.nbytes / 2**20:.1f} MiB"
    say_result(text, file=args.out, depth=octree.depth, leaves=octree.leaf_count)
    if args.timings:
        print(json.dumps(clock.as_json()))
    return 0


def check_out(args: argparse.Namespace) -> None:
    """Raise OutputError if --out cannot be written, or would replace what the open or the named scene is read from."""
    from ..operators.pipeline.output_files import scene_inputs
    from ..operators.pipeline.reports import REPORT_NAME
    from ..patchnet_addon.runtime.file_kinds import OCTREE, REPORT
    from ..patchnet_addon.runtime.outputs import check_outputs

    inputs, folder = [*scene_inputs(), *filter(None, [args.scene])], None if args.frames is None else args.out
    check_outputs({args.out: OCTREE} if folder is None else {folder / REPORT_NAME: REPORT}, inputs, folder=folder)


def _check(args: argparse.Namespace) -> None:
    """Raise SettingError for settings that are impossible or contradict each other."""
    check_frames(args)
    if args.frames is not None and args.timings:
        raise SettingError("--timings are those of one octree: leave them out with --frames")
    if args.same_grid and args.rotate:
        raise SettingError("--same-grid and --rotate contradict each other: leave one of them out")
    if args.depth != FIT:
        if not args.depth.isdecimal():
            raise SettingError(f"Depth {args.depth!r} is neither a whole number nor '{FIT}'")
        bounds.DEPTH.read(args.depth)
        if args.view:
            raise SettingError(f"--view is what --depth {FIT} fits to: leave it out with a depth")
    elif not args.view:
        raise SettingError(f"--depth {FIT} needs at least one --view to fit to")
    elif args.rotate:
        raise SettingError(f"--depth {FIT} and --rotate contradict each other: leave one of them out")


def without(args: argparse.Namespace) -> list[str]:
    """Texts of --without, in lower case."""
    return [text.strip().lower() for text in args.without.split(",") if text.strip()]


def hide_from_renders(texts: list[str]) -> None:
    """Hide objects whose own or an ancestor's name contains one of `texts` (lower case)."""
    import bpy

    for item in bpy.data.objects:
        ancestor = item
        while ancestor is not None and not any(text in ancestor.name.lower() for text in texts):
            ancestor = ancestor.parent
        item.hide_render = item.hide_render or ancestor is not None


def build(args: argparse.Namespace, clock: StageClock, kept: KeptPages) -> Steps[Octree]:
    """Build the octree of the scene that is open, at its present frame."""
    import bpy

    from ..operators.pipeline.versions import versions
    from ..operators.scene import read_scene
    from ..operators.scene.precision import light_warnings, place_warnings
    from ..patchnet_addon.lightmap.texel_sizes import texel_sizes
    from ..patchnet_addon.octree.build import build_octree
    from ..patchnet_addon.octree.grid import Grid
    from ..patchnet_addon.surface.rotated import RotatedSource, random_rotation

    with clock.stage("read"):
        source = read_scene(bpy.context.evaluated_depsgraph_get())
    with clock.stage("fit" if args.depth == FIT else "grid"):
        grid, layout = yield from _grid(args, source)
    lit = light_warnings(source, grid) if args.light == "cycles" else ()
    for warning in (*source.warnings, *place_warnings(source, grid), *lit):
        say_note(warning)
    with clock.stage("light"):
        shade = yield from _shade(args, source, texel_sizes(source, grid, layout, args.texel_voxels), kept)
    turned: MeshSource = RotatedSource(source, random_rotation(args.rotate)) if args.rotate else source
    provenance: dict[str, Any] = {
        "file": scene_path(args.scene).name,
        "triangles": source.triangle_count,
        "light": args.light,
        "rotation": args.rotate,
        "without": args.without,
        "fitted": layout is not None,
        "exposure": "automatic" if args.exposure is None else "given",
        "color": args.color,
        "both_sides": args.both_sides,
        "versions": versions(),
    }
    if args.light == "cycles":
        provenance |= {"samples": args.samples, "texel_voxels": args.texel_voxels}
    with clock.stage("build"):
        if args.rotate:
            grid = Grid.around(turned.bounds_world, grid.depth)
        steps = build_octree(turned, grid, shade, layout=layout, exposure=args.exposure, provenance=provenance)
        octree = yield from steps
    if layout is not None:
        say_unseen(octree, view_cameras(args))
    return octree


def _grid(args: argparse.Namespace, source: MeshSource) -> Steps[tuple[Grid, LeafLevels | None]]:
    """Cube and depth of the upright surface, and the levels of the leaves where they are fitted."""
    from ..patchnet_addon.lod.depth import available_memory, most_leaves
    from ..patchnet_addon.lod.fit import LAYOUT_BYTES, fit_leaf_levels
    from ..patchnet_addon.octree.grid import Grid
    from ..patchnet_addon.runtime.bounds import MAX_DEPTH
    from ..patchnet_addon.surface.opacity import opacity_shade

    bounds_world = source.bounds_world if args.bounds is None else np.array(args.bounds)
    if args.depth != FIT:
        return Grid.around(bounds_world, int(args.depth)), None
    grid = Grid.around(bounds_world, MAX_DEPTH)
    memory = available_memory() if args.memory is None else args.memory * 2**30
    most = most_leaves(memory - LAYOUT_BYTES, color=args.color)
    fitted = yield from fit_leaf_levels(source, grid, view_cameras(args), opacity_shade(source), most_leaves=most)
    return replace(grid, depth=fitted.layout.deepest), fitted.layout


def _shade(args: argparse.Namespace, source: Any, texel_world: float | np.ndarray, kept: KeptPages) -> Steps[Shade]:
    """Shade of the upright surface with baked light, or of the turned one with two lights."""
    import bpy

    from ..operators.cycles.bake import bake_luminance
    from ..operators.cycles.daylight import has_light
    from ..operators.pipeline.stages import NO_LIGHT
    from ..patchnet_addon.lightmap.atlas import atlas_shade
    from ..patchnet_addon.surface.two_lights import DIRECTION, two_lights_shade

    if args.light == "two-lights":
        direction = np.random.default_rng(args.rotate).normal(size=3) if args.rotate else np.array(DIRECTION)
        x, y, z = (float(value) for value in direction)
        return two_lights_shade(source, (x, y, z), color=args.color)
    lit = has_light(bpy.context.evaluated_depsgraph_get()) if args.daylight is None else not args.daylight
    if not lit:
        say_note(NO_LIGHT)
    atlas = yield from bake_luminance(
        bpy.context,
        source,
        texel_world,
        args.samples,
        color=args.color,
        both_sides=args.both_sides,
        kept=kept,
        with_daylight=not lit,
    )
    for warning in atlas.warnings:
        say_note(warning)
    return atlas_shade(atlas, source)
