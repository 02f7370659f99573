# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet run SCENE`: from a scene file to refined pictures, heatmaps and a report."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from ..patchnet_addon.runtime import bounds
from ..patchnet_addon.runtime.errors import PatchNetError, SettingError
from .arguments import add_number, add_out
from .cycles import add_cycles, cycles_settings, print_cycles
from .frames import add_frames, bake_with_bars, check_frames, print_frames
from .lines import say_note, say_result
from .scene_argument import add_scene, open_given, scene_path

if TYPE_CHECKING:
    from ..operators.job.run import JobResult
    from ..operators.job.settings import JobSettings

DEFAULT_OUT = "out"


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:  # type: ignore[type-arg]
    """Arguments of `patchnet run`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "run",
        help="refine the views of a scene where a coarse picture is wrong",
        description="Voxelize a scene, bake its light, look ahead with PatchNet, refine its views, and report errors.",
    )
    add_scene(parser, ".blend, .glb, .gltf, .obj, .ply, .stl, .fbx or .usd file")
    parser.add_argument("--scope", choices=("visible", "selected"), default="visible", help="which objects (visible)")
    add_job_arguments(parser)
    add_frames(parser)
    add_out(parser, "folder for the results (out/NAME-OF-SCENE)")
    return parser


def add_job_arguments(parser: argparse.ArgumentParser) -> None:
    """The settings of a job, which `patchnet demo` shares."""
    parser.add_argument(
        "--depth", default="auto",
        help="octree depth; auto: 95 %% look-ahead for all cameras; fit: fine only where the cameras look (auto)",
    )  # fmt: skip
    parser.add_argument("--track", action="store_true", help="with --depth fit: the cameras at all frames of the scene")
    add_number(
        parser, "--memory", bounds.MEMORY_GIB, metavar="GIB", help="what the octree may take while it is built (all)"
    )
    add_number(
        parser, "--voxel-size", bounds.VOXEL_SIZE, help="side of the finest voxels in world units, instead of a depth"
    )
    parser.add_argument("--light", choices=("cycles", "two-lights"), default="cycles", help="light (cycles)")
    add_number(parser, "--samples", bounds.SAMPLES, default=8, help="Cycles samples per baked texel (8)")
    add_number(
        parser, "--texel-voxels", bounds.TEXEL_VOXELS, default=2.0, help="side of a baked texel in finest voxels (2)"
    )
    add_exposure(parser)
    parser.add_argument("--cameras", default="", help="names with commas between, all, or auto (the active camera)")
    add_number(
        parser, "--size", bounds.SIZE_PX, nargs=2, default=(192, 192), metavar=("W", "H"),
        help="pixels of the pictures; a 0 follows the render aspect, 0 0 is the render resolution (192 192)",
    )  # fmt: skip
    add_color(parser)
    add_both_sides(parser)
    add_number(parser, "--budget", bounds.BUDGET, default=0.3, help="share of active pixels to refine, 0 to 1 (0.3)")
    parser.add_argument("--strategy", default="patchnet-behind", help="what is refined first (patchnet-behind)")
    parser.add_argument(
        "--mask", type=Path, metavar="IMAGE",
        help="painted importance, stretched over each view: multiplies the priority, black is never refined",
    )  # fmt: skip
    add_number(parser, "--heatmap-max", bounds.HEATMAP_MAXIMUM, help="priority at the end of the heatmap's legend")
    parser.add_argument("--colormap", default="viridis", help="viridis or turbo (viridis)")
    parser.add_argument("--weights", type=Path, help="weights file instead of the one that is shipped")
    add_cycles(parser)


def add_both_sides(parser: argparse.ArgumentParser) -> None:
    """`--both-sides`."""
    parser.add_argument(
        "--both-sides",
        action="store_true",
        help="opaque sheets have the mean of both sides (the side that normals show)",
    )


def add_color(parser: argparse.ArgumentParser) -> None:
    """The argument that all commands share which write octrees."""
    parser.add_argument(
        "--color", action="store_true", help="keep colour beside luminance, for pictures and exports (luminance alone)"
    )


def add_exposure(parser: argparse.ArgumentParser) -> None:
    """The argument that all commands share which write lit octrees."""
    add_number(
        parser, "--exposure", bounds.EXPOSURE, metavar="FACTOR",
        help="factor on luminance (the one that brings its 99.5 %% quantile to 1)",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Run the job and print its figures; returns 0. Raises PatchNetError."""
    check_frames(args)
    require_blender()
    from ..operators.job.output_files import check_job

    settings = job_settings(args, args.out or Path(DEFAULT_OUT) / scene_path(args.scene).stem)
    check_job(settings, args.scene, frames=args.frames is not None)
    open_given(args.scene)
    if args.frames is not None:
        return _run_frames(args, settings)
    print_result(run_with_bars(settings), settings)
    return 0


def _run_frames(args: argparse.Namespace, settings: JobSettings) -> int:
    from ..operators.job.frame_maker import JobMaker

    assert settings.out is not None
    if settings.track:
        raise SettingError("Each frame's octree fits that frame's cameras: leave out --track with --frames")
    print_frames(bake_with_bars(args, JobMaker(settings), settings.out), settings.out)
    return 0


def require_blender() -> None:
    """Raises PatchNetError that says what to install if Blender is not there as a Python module."""
    try:
        import bpy  # noqa: F401
    except ImportError as cause:
        raise PatchNetError(
            f"Blender is not there as a Python module ({cause}): install patchnet-blender[blender] and the system "
            "libraries that README names"
        ) from cause
    from ..operators.session_folder import session_folder_goes

    session_folder_goes()


def job_settings(args: argparse.Namespace, out: Path) -> JobSettings:
    """Settings of a job from parsed arguments; raises SettingError for values outside their range."""
    from ..operators.importance import Importance
    from ..operators.job.settings import JobSettings
    from ..operators.scene.placements import SELECTED, VISIBLE

    return JobSettings(
        scope=SELECTED if getattr(args, "scope", "visible") == "selected" else VISIBLE,
        depth=_depth(args.depth),
        voxel_world=args.voxel_size,
        fit=args.depth == "fit",
        track=args.track,
        memory_bytes=None if args.memory is None else round(args.memory * 2**30),
        light=args.light,
        samples=args.samples,
        exposure=args.exposure,
        both_sides=args.both_sides,
        color=args.color,
        texel_voxels=args.texel_voxels,
        cameras=tuple(name.strip() for name in args.cameras.split(",") if name.strip()),
        size=tuple(args.size),
        budget=args.budget,
        strategy=args.strategy,
        heatmap_maximum=args.heatmap_max,
        colormap=args.colormap,
        weights=args.weights,
        out=out,
        cycles=cycles_settings(args),
        importance=None if args.mask is None else Importance(file=args.mask.absolute()),
    )


def run_with_bars(settings: JobSettings) -> JobResult:
    """Run the job on the scene that is open in Blender, with progress bars on stderr."""
    import bpy

    from ..operators.job.run import run_job
    from ..patchnet_addon.runtime.progress import drain
    from .progress_bars import ProgressBars
    from .quiet import quiet_stdout

    with quiet_stdout(), ProgressBars() as bars:
        return drain(run_job(bpy.context, settings), bars.show)


def print_result(result: JobResult, settings: JobSettings) -> None:
    """Warnings, the octree, and what is left of the error by strategy."""
    for warning in result.warnings:
        say_note(warning)
    octree = result.report["octree"]
    depth = f"{'up to ' if octree['fitted'] else ''}{octree['depth']}"
    print(
        f"Octree: depth {depth}, {octree['leaves']:,} voxels, {octree['nodes']:,} nodes, "
        f"{(octree['bytes'] + octree['codes_bytes']) / 2**20:.1f} MiB with codes"
    )
    for frame in result.report["frames"]:
        width, height = frame["size"]
        print(
            f"{frame['camera']} {width} x {height}: look-ahead on {frame['lookahead_share']:.1%} of hits, "
            f"error {frame['mse_unrefined']:.2e}, after refining {settings.budget:.0%} of {frame['active_pixels']}:"
        )
        for name, value in sorted(frame["mse"].items(), key=lambda item: item[1]):
            marker = " <" if name == settings.strategy else ""
            print(f"  {name:<24} {value:.2e}{marker}")
        print_cycles(frame.get("cycles"))
    views = [
        {"camera": frame["camera"], "mse_unrefined": frame["mse_unrefined"], "mse": frame["mse"][settings.strategy]}
        for frame in result.report["frames"]
    ]
    figures = {"depth": octree["depth"], "leaves": octree["leaves"], "views": views}
    say_result(f"Results are in {settings.out}", file=settings.out, **figures)


def _depth(text: str) -> int | None:
    if text in ("auto", "fit"):
        return None
    if not re.fullmatch(r"[+-]?\d+", text):
        raise SettingError(f"Depth {text!r} is neither a whole number nor 'auto' or 'fit'")
    return int(bounds.DEPTH.read(text))
