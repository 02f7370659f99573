# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet octree SCENE`: the lit octree of a scene alone, as training needs it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..patchnet_addon.errors import SettingError
from .quiet import quiet_stdout
from .run import add_exposure, require_blender
from .stage_clock import StageClock

if TYPE_CHECKING:
    from ..patchnet_addon.light.kept_pages import KeptPages
    from ..patchnet_addon.octree.mesh import MeshSource, Shade
    from ..patchnet_addon.octree.octree import Octree
    from ..patchnet_addon.progress import Steps


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:  # type: ignore[type-arg]
    """Arguments of `patchnet octree`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "octree",
        help="voxelize and light a scene",
        description="Write the lit octree of a scene, upright or turned, for training and experiments.",
    )
    parser.add_argument("scene", type=Path, help="scene file, as for `patchnet run`")
    parser.add_argument("--depth", type=int, required=True, help="octree depth")
    parser.add_argument("--light", choices=("cycles", "two-lights"), default="cycles", help="light (cycles)")
    parser.add_argument("--samples", type=int, default=8, help="Cycles samples per baked texel (8)")
    parser.add_argument("--texel-voxels", type=float, default=2.0, help="side of a baked texel in leaf voxels (2)")
    add_exposure(parser)
    parser.add_argument(
        "--rotate", type=int, default=0, metavar="SEED",
        help="turn the lit surface by a random rotation; two-lights then shines from a random direction (0: upright)",
    )  # fmt: skip
    parser.add_argument(
        "--without", default="", metavar="TEXT,TEXT", help="leave out objects below a name with one of these texts"
    )
    parser.add_argument("--out", type=Path, required=True, help="octree file to write")
    parser.add_argument(
        "--timings", action="store_true", help="end with a line of JSON: seconds and peak memory of each stage"
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Build the octree and write it; returns 0. Raises PatchNetError."""
    clock = StageClock()
    with clock.stage("start"):
        require_blender()
    from ..operators.scene import open_scene
    from ..patchnet_addon.light.kept_pages import KeptPages
    from ..patchnet_addon.octree.file import save_octree
    from ..patchnet_addon.progress import drain
    from .progress_bars import ProgressBars

    if not args.texel_voxels > 0:
        raise SettingError(f"Texels of {args.texel_voxels} voxels are impossible: give a positive number")
    if args.exposure is not None and not 0.0 < args.exposure < np.inf:
        raise SettingError(f"Exposure {args.exposure} must be a positive number, or left out to be automatic")
    with quiet_stdout(), clock.stage("open"):
        open_scene(args.scene)
    hide_from_renders([text.strip().lower() for text in args.without.split(",") if text.strip()])
    args.out.parent.mkdir(parents=True, exist_ok=True)
    with KeptPages() as kept:
        with quiet_stdout(), ProgressBars() as bars:
            octree = drain(_build(args, clock, kept), bars.show)
        with clock.stage("save"):
            save_octree(octree, args.out)
    print(f"{args.out}: depth {octree.depth}, {octree.leaf_count:,} voxels, {octree.nbytes / 2**20:.1f} MiB")
    if args.timings:
        print(json.dumps(clock.as_json()))
    return 0


def hide_from_renders(texts: list[str]) -> None:
    """Hide objects whose own or an ancestor's name contains one of `texts` (lower case)."""
    import bpy

    for item in bpy.data.objects:
        ancestor = item
        while ancestor is not None and not any(text in ancestor.name.lower() for text in texts):
            ancestor = ancestor.parent
        item.hide_render = item.hide_render or ancestor is not None


def _build(args: argparse.Namespace, clock: StageClock, kept: KeptPages) -> Steps[Octree]:
    import bpy

    from ..operators.job.versions import versions
    from ..operators.scene import read_scene
    from ..patchnet_addon.octree.build import build_octree
    from ..patchnet_addon.octree.grid import Grid
    from ..patchnet_addon.octree.rotated import RotatedSource, random_rotation

    with clock.stage("read"):
        source = read_scene(bpy.context.evaluated_depsgraph_get())
    with clock.stage("light"):
        shade = yield from _shade(args, source, kept)
    turned: MeshSource = RotatedSource(source, random_rotation(args.rotate)) if args.rotate else source
    provenance: dict[str, Any] = {
        "file": args.scene.name,
        "triangles": source.triangle_count,
        "light": args.light,
        "rotation": args.rotate,
        "without": args.without,
        "exposure": "automatic" if args.exposure is None else "given",
        "versions": versions(),
    }
    if args.light == "cycles":
        provenance |= {"samples": args.samples, "texel_voxels": args.texel_voxels}
    with clock.stage("build"):
        grid = Grid.around(turned.bounds_world, args.depth)
        return (yield from build_octree(turned, grid, shade, exposure=args.exposure, provenance=provenance))


def _shade(args: argparse.Namespace, source: Any, kept: KeptPages) -> Steps[Shade]:
    """Shade of the upright surface with baked light, or of the turned one with two lights."""
    import bpy

    from ..operators.bake import bake_luminance
    from ..operators.daylight import has_light, in_daylight
    from ..operators.job.stages import NO_LIGHT
    from ..patchnet_addon.light.atlas import atlas_shade
    from ..patchnet_addon.light.two_lights import DIRECTION, two_lights_shade
    from ..patchnet_addon.octree.grid import Grid

    if args.light == "two-lights":
        direction = np.random.default_rng(args.rotate).normal(size=3) if args.rotate else np.array(DIRECTION)
        x, y, z = (float(value) for value in direction)
        return two_lights_shade(source, (x, y, z))
    texel = Grid.around(source.bounds_world, args.depth).voxel_world * args.texel_voxels
    lit = has_light(bpy.context.evaluated_depsgraph_get())
    if not lit:
        print(f"Note: {NO_LIGHT}", file=sys.stderr)
    baking = bake_luminance(bpy.context, source, texel, args.samples, kept=kept)
    atlas = yield from baking if lit else in_daylight(bpy.context.scene, baking)
    return atlas_shade(atlas, source)
