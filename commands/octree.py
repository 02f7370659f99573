# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet octree SCENE`: write the lit octree of a scene, upright or rotated, for training and experiments."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from ..patchnet_addon.runtime import bounds
from ..patchnet_addon.runtime.errors import SettingError
from ..patchnet_addon.runtime.quantities import counted
from ..patchnet_addon.runtime.stage_clock import StageClock
from .shared.arguments import add_number, add_out, is_given
from .shared.job_arguments import add_settings, depth_of, given_settings, require_blender
from .shared.lines import make_parent, say_exposure, say_note, say_result
from .shared.quiet import quiet_stdout
from .shared.scene_argument import OWN, add_scene, open_or_build, scene_path
from .shared.views import add_views, view_cameras

if TYPE_CHECKING:
    from ..operators.pipeline.lit_octree import OctreeOverrides
    from ..operators.settings.job_settings import JobSettings

AUTO = "auto"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    from ..operators.schema.values import BOX_SHAPE, LIGHT
    from ..operators.settings.job_settings import TABLE

    add_scene(parser, "scene file, as for `patchnet run`; demo: the courtyard; room: a closed room")
    parser.add_argument("--depth", required=True, help="octree depth; auto: fine only in the views")
    add_views(parser)
    add_settings(parser, LIGHT, without=("cells", "color"))
    parser.add_argument(
        "--surface", choices=[value for value, _, _ in TABLE["shape"].choices], default=BOX_SHAPE,
        help="where rays that reach the finest voxels end (boxes: training and the paper's figures know no others)",
    )  # fmt: skip
    parser.add_argument(
        "--color", action=argparse.BooleanOptionalAction, default=False,
        help="keep color beside luminance, for exports and pictures (off: training reads luminance alone)",
    )  # fmt: skip
    text = "turn the lit surface by a random rotation, 0: upright; two-lights then shines from a random direction"
    add_number(parser, "--rotate", bounds.SEED, text, 0, metavar="SEED")
    parser.add_argument(
        "--without", default="", metavar="TEXT,TEXT", help="leave out objects below a name with one of these texts"
    )
    parser.add_argument(
        "--bisect", nargs=2, metavar=("AXIS", "SHARE"),
        help="leave out what lies beyond a plane across x, y or z, at a share (0 to 1) of the scene's extent; baked "
        "light stays that of the whole scene",
    )  # fmt: skip
    add_out(parser, "octree file to write", required=True)
    parser.add_argument(
        "--timings", action="store_true", help="print a line of JSON at the end: seconds of each stage, and peak memory"
    )


def run(args: argparse.Namespace) -> int:
    """Build the octree and write it; returns 0; raises PatchNetError."""
    _check(args)
    clock = StageClock()
    with clock.stage("start"):
        require_blender()
    from ..operators.pipeline.lit_octree import build_lit_octree
    from ..operators.scene.render_geometry import hide_from_renders
    from ..patchnet_addon.octree.file import save_octree
    from ..patchnet_addon.process.computed import answer
    from ..patchnet_addon.runtime.memory import peak_bytes
    from ..patchnet_addon.runtime.progress import drain
    from ..patchnet_addon.tracing.empty_view import why_unseen_by
    from .shared.progress_lines import progress_lines

    check_out(args)
    with clock.stage("open"):
        open_or_build(None if args.scene is None else str(args.scene))
    check_out(args)
    settings, overrides = _settings(args), _overrides(args)
    for text in hide_from_renders(_without(args)):
        say_note(f"--without {text}: no object, and nothing above one, has a name with it")
    make_parent(args.out)
    import bpy

    with quiet_stdout():
        made = drain(build_lit_octree(bpy.context, settings, clock, overrides), progress_lines())
    with clock.stage("save"):
        save_octree(made.octree, args.out)
    octree = made.octree
    for warning in [*made.warnings, *answer(why_unseen_by, octree, view_cameras(args))]:
        say_note(warning)
    text = f"{args.out}: depth {octree.depth}, {counted(octree.leaf_count, 'voxel')}, {octree.nbytes / 2**20:.1f} MiB"
    say_exposure(octree)
    say_result(text, file=args.out, depth=octree.depth, leaves=octree.leaf_count)
    if args.timings:
        print(json.dumps({"stages": clock.seconds, "peak_bytes": peak_bytes()}))
    return 0


def _settings(args: argparse.Namespace) -> JobSettings:
    from ..operators.schema.values import ALL_CELLS, GLOSS_CAMERA, LIGHT, OCTREE, SEEN_CELLS
    from ..operators.settings.job_settings import JobSettings

    given = given_settings(args, OCTREE, LIGHT)
    if args.gloss != GLOSS_CAMERA:  # for any camera
        given["from_camera"] = False
    given["cells"] = SEEN_CELLS if args.view else ALL_CELLS
    return JobSettings.of(**given)


def _overrides(args: argparse.Namespace) -> OctreeOverrides:
    """Overrides of the settings: views to fit the octree to, a rotation, objects to leave out."""
    from ..operators.pipeline.lit_octree import OctreeOverrides

    notes = {"file": scene_path(args.scene).name, "rotation": args.rotate, "without": args.without}
    bisect = _bisect(args)
    if bisect is not None:
        notes["bisect"] = args.bisect
    return OctreeOverrides(cameras=lambda: view_cameras(args), rotation=args.rotate, bisect=bisect, provenance=notes)


def check_out(args: argparse.Namespace) -> None:
    """Raise OutputError if --out cannot be written, or would replace a file of the scene."""
    from ..operators.pipeline.output_files import scene_inputs
    from ..patchnet_addon.runtime.file_kinds import OCTREE
    from ..patchnet_addon.runtime.outputs import check_outputs

    given = [] if args.scene is None or str(args.scene) in OWN else [args.scene]
    check_outputs({args.out: OCTREE}, [*scene_inputs(), *given])


def _check(args: argparse.Namespace) -> None:
    """Raise SettingError for conflicting settings."""
    if _bisect(args) is not None and (args.rotate or args.depth == AUTO):
        other = "--rotate" if args.rotate else f"--depth {AUTO}"
        raise SettingError(f"--bisect and {other} exclude each other: omit one of them")
    if args.depth != AUTO:
        depth_of(args.depth)
        if args.view:
            raise SettingError(f"--view requires --depth {AUTO}: omit it with another depth")
        if is_given(args, "--size"):
            raise SettingError("--size requires --view, of whose pictures it is the size: omit it")
    elif not args.view:
        raise SettingError(f"--depth {AUTO} needs at least one --view to fit to")
    elif args.rotate:
        raise SettingError(f"--depth {AUTO} and --rotate exclude each other: omit one of them")


def _without(args: argparse.Namespace) -> list[str]:
    """Values of --without in lower case."""
    return [text.strip().lower() for text in args.without.split(",") if text.strip()]


def _bisect(args: argparse.Namespace) -> tuple[int, float] | None:
    """Axis and share of --bisect; raises SettingError."""
    from ..patchnet_addon.surface.mesh import AXES

    if args.bisect is None:
        return None
    axis, share = args.bisect
    if axis.lower() not in AXES:
        raise SettingError(f"--bisect {axis} is not an axis: choose x, y or z")
    return AXES.index(axis.lower()), bounds.SHARE.read(share, "--bisect")
