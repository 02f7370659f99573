# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet run SCENE`: voxelize a scene, bake its light, encode it with PatchNet, refine its views, and report."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..patchnet_addon.runtime.quantities import counted, error_text
from .shared.arguments import add_out
from .shared.frames import add_frames, bake_with_lines, check_frames, print_frames
from .shared.job_arguments import add_job_arguments, job_settings, require_blender
from .shared.lines import say_exposure, say_note, say_result
from .shared.scene_argument import add_scene, open_given, scene_path

if TYPE_CHECKING:
    from ..operators.pipeline.run import Before, JobResult
    from ..operators.settings.groups import ViewSettings
    from ..operators.settings.job_settings import JobSettings

_CYCLES_TITLES = {
    "preview": "preview",
    "predicted": "predicted",
    "refined_octree": "refined octree",
    "composited_over_unrefined": "Cycles over unrefined",
    "composited": "Cycles over own rays",
    "full": "full Cycles render",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_scene(parser, ".blend, .glb, .gltf, .obj, .ply, .stl, .fbx or .usd file")
    parser.add_argument("--scope", choices=("visible", "selected"), default="visible", help="objects (visible)")
    add_job_arguments(parser)
    add_frames(parser)
    add_out(parser, "folder for the results (out/NAME-OF-SCENE)")


def run(args: argparse.Namespace) -> int:
    """Run the job and print its figures; returns 0; raises PatchNetError."""
    check_frames(args)
    require_blender()
    from ..operators.pipeline.output_files import check_job

    settings = job_settings(args, args.out or Path("out") / scene_path(args.scene).stem)
    check_job(settings, args.scene, frames=args.frames is not None)
    open_given(args.scene)
    if args.frames is not None:
        return _run_frames(args, settings)
    print_result(_run_cached(settings), settings)
    return 0


def _run_frames(args: argparse.Namespace, settings: JobSettings) -> int:
    from ..operators.animation.frame_maker import JobMaker

    assert settings.out is not None
    print_frames(bake_with_lines(args, JobMaker(settings), settings.out), settings.out)
    return 0


def run_with_lines(settings: JobSettings, before: Before | None = None) -> JobResult:
    """Run the job on the open scene with progress lines on stderr. before: voxels that it reuses."""
    import bpy

    from ..operators.pipeline.run import run_job
    from ..patchnet_addon.runtime.progress import drain
    from .shared.progress_lines import progress_lines
    from .shared.quiet import quiet_stdout

    with quiet_stdout():
        return drain(run_job(bpy.context, settings, before=before), progress_lines())


def _run_cached(settings: JobSettings) -> JobResult:
    """Run the job with voxels of the cache folder, which keeps those that it makes."""
    import bpy

    from ..operators.session.job_voxels import key_of_job, result_of_job, voxels_before
    from ..operators.session.octree_cache import keep_on_disk

    key = key_of_job(bpy.context, settings)
    before = voxels_before(bpy.context, settings, key)
    result = run_with_lines(settings, before)
    if before is None or not before.lit:
        keep_on_disk(bpy.context.scene, result_of_job(bpy.context, settings, result, key), apart=True)
    return result


def print_result(result: JobResult, settings: JobSettings) -> None:
    """Print warnings, the octree, the views, and with a reference the remaining error by strategy."""
    from ..operators.pipeline.output_files import OVERVIEW_NAME

    assert settings.out is not None
    for warning in result.warnings:
        say_note(warning)
    octree = result.report["octree"]
    depth = f"{'up to ' if octree['fitted'] else ''}{octree['depth']}"
    print(
        f"Octree: depth {depth}, {counted(octree['leaves'], 'voxel')}, {counted(octree['nodes'], 'node')}, "
        f"{(octree['bytes'] + octree['codes_bytes']) / 2**20:.1f} MiB with codes"
    )
    say_exposure(result.coded.octree)
    for view in result.report["frames"]:
        _print_view(view, settings.view)
    views = [_view_figures(view) for view in result.report["frames"]]
    figures = {"depth": octree["depth"], "leaves": octree["leaves"], "views": views}
    say_result(f"Results are in {settings.out}: look at {settings.out / OVERVIEW_NAME}", file=settings.out, **figures)


def _print_view(view: dict[str, Any], wanted: ViewSettings) -> None:
    from ..patchnet_addon.sampling.report import has_errors

    width, height = view["size"]
    title = f"{view['camera']} {width} x {height}: look-ahead on {view['lookahead_share']:.1%} of hits"
    refined = view["refined"]
    spread = ", ".join(f"{int(count):,} in {pixels:,}" for count, pixels in refined["pixels"].items() if pixels)
    if has_errors(view):
        _print_errors(view, wanted, title)
    else:
        print(title)
    print(f"  {refined['spent']:.4g} samples per active pixel by priority ({wanted.strategy}): {spread} pixels")
    if "mse" in refined:
        share = error_text(refined["mse_of_share"])
        print(f"  Error of refined.png {error_text(refined['mse'])}; as many rays as a share of 1,024 each {share}")
    if "cycles" in view:
        _print_cycles(view["cycles"])


def _print_errors(view: dict[str, Any], wanted: ViewSettings, title: str) -> None:
    """Print the error of every strategy, and of unrefined pictures."""
    from ..patchnet_addon.sampling.registry import STRATEGIES
    from ..patchnet_addon.sampling.report import shown_figures

    shown = shown_figures(view)
    print(f"{title}, error {error_text(shown['mse_unrefined'])} (mean squared, x 10,000)")
    print(f"  after {wanted.budget:.0%} of {view['active_pixels']:,} pixels are without error, chosen by")
    for name, value in sorted(shown["mse"].items(), key=lambda item: item[1]):
        chosen = " <" if name == wanted.strategy else ""
        print(f"  {name:<24} {error_text(value):>6}  {STRATEGIES[name].cost}{chosen}")
    pictures = {"preview": view["mse_unrefined"], "predicted": view["predicted"]["mse_unrefined"]}
    pictures |= {f"{side} x {side} rays": error for side, error in view.get("uniform", {}).items() if side != "1"}
    print(f"  Unrefined: {', '.join(f'{name} {error_text(error)}' for name, error in pictures.items())}")


def _print_cycles(report: dict[str, Any]) -> None:
    """Print figures of a view's pixels by Cycles."""
    seconds = report["seconds"]
    text = f"Cycles on {report['pixels_share']:.1%} of pixels: "
    text += f"{seconds['pixels']:.1f} s, {seconds['of_that_reading_the_scene']:.1f} s of that reading the scene"
    print(text + (f"; full render {seconds['full']:.1f} s" if "full" in seconds else ""))
    for name, value in report.get("mse", {}).items():
        print(f"  {_CYCLES_TITLES[name]:<24} {error_text(value):>6}")


def _view_figures(view: dict[str, Any]) -> dict[str, Any]:
    """Figures of a view for the log."""
    from ..patchnet_addon.sampling.report import shown_errors

    errors = shown_errors(view)
    stated = {} if errors is None else {"mse_unrefined": errors[0], "mse": errors[1]}
    return {"camera": view["camera"], "spent": view["refined"]["spent"], **stated}
