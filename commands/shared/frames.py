# SPDX-License-Identifier: GPL-3.0-or-later
"""Frame arguments (`--frames`) of `patchnet run`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.frames import frame_range, parse_frames
from .lines import say_note, say_result

if TYPE_CHECKING:
    from ...operators.animation.animation import AnimationResult
    from ...operators.animation.frame_maker import JobMaker


def add_frames(parser: argparse.ArgumentParser) -> None:
    """Add --frames, --overwrite and --same-grid."""
    parser.add_argument(
        "--frames", metavar="FRAMES",
        help="bake these frames one after the other, each into a folder of its own: 1-24, 1-24x2, 1,5,9, or all of the "
        "scene's range; existing frames are skipped",
    )  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="with --frames: replace existing frames")
    parser.add_argument(
        "--same-grid", action="store_true",
        help="with --frames: one cube for all octrees, for temporal stability; reads all frames first",
    )  # fmt: skip


def check_frames(args: argparse.Namespace) -> None:
    """Raise SettingError for invalid frames before a scene is opened."""
    if args.frames is not None:
        parse_frames(args.frames)
    elif args.overwrite or args.same_grid:
        raise SettingError(f"--{'overwrite' if args.overwrite else 'same-grid'} requires --frames: add it")


def bake_with_lines(args: argparse.Namespace, maker: JobMaker, out: Path) -> AnimationResult:
    """Bake frames of the open scene with progress lines on stderr."""
    import bpy

    from ...operators.animation.animation import FramePlan, bake_frames
    from ...patchnet_addon.runtime.progress import drain
    from .progress_lines import progress_lines
    from .quiet import quiet_stdout

    scene = bpy.context.scene
    frames = parse_frames(args.frames, frame_range(scene.frame_start, scene.frame_end, scene.frame_step))
    plan = FramePlan(frames, out, args.overwrite, args.same_grid)
    with quiet_stdout():
        return drain(bake_frames(bpy.context, maker, plan), progress_lines())


def print_frames(result: AnimationResult, out: Path) -> None:
    """Print warnings, a line per frame, and the path of the results."""
    for warning in result.warnings:
        say_note(warning)
    for entry in result.report["frames"]:
        frame = entry["frame"]
        skipped = frame in result.skipped
        text = f"Frame {frame} is there: skipped" if skipped else f"Frame {frame}: {_figures(entry)}"
        say_result(text, frame=frame, file=out / entry["folder"], skipped=skipped)
    say_result(f"{result.sentence()}; results are in {out}", file=out, made=result.made, skipped=result.skipped)


def _figures(entry: dict[str, Any]) -> str:
    from ...patchnet_addon.runtime.quantities import counted, error_text
    from ...patchnet_addon.sampling.report import shown_errors

    octree = entry["octree"]
    figures = [f"depth {octree['depth']}, {counted(octree['leaves'], 'voxel')}"]
    for view in entry["views"]:
        errors = shown_errors(view)
        samples = f"{view['refined']['spent']:.3g} samples a pixel"
        error = "" if errors is None else f", error {error_text(errors[0])} -> {error_text(errors[1])}"
        figures.append(f"{view['camera']} {samples}{error}")
    return "; ".join(figures)
