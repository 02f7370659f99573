# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments of a job, which several sub-commands share, and the settings that they give."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from .arguments import add_number
from .cycles import add_cycles, cycles_settings

if TYPE_CHECKING:
    from ...operators.settings.job_settings import JobSettings


def add_job_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings of a job, which `patchnet demo` shares."""
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
    """Add the argument `--both-sides`."""
    parser.add_argument(
        "--both-sides",
        action="store_true",
        help="opaque sheets have the mean of both sides (the side that normals show)",
    )


def add_color(parser: argparse.ArgumentParser) -> None:
    """Add the argument that all commands share which write octrees."""
    parser.add_argument(
        "--color", action="store_true", help="keep colour beside luminance, for pictures and exports (luminance alone)"
    )


def add_exposure(parser: argparse.ArgumentParser) -> None:
    """Add the argument that all commands share which write lit octrees."""
    add_number(
        parser, "--exposure", bounds.EXPOSURE, metavar="FACTOR",
        help="factor on luminance (the one that brings its 99.5 %% quantile to 1)",
    )  # fmt: skip


def require_blender() -> None:
    """Raise PatchNetError that says what to install if Blender is not there as a Python module."""
    try:
        import bpy  # noqa: F401
    except ImportError as cause:
        raise PatchNetError(
            f"Blender is not there as a Python module ({cause}): install patchnet-blender[blender] and the system "
            "libraries that README names"
        ) from cause
    from ...operators.jobs.session_folder import session_folder_goes

    session_folder_goes()


def job_settings(args: argparse.Namespace, out: Path) -> JobSettings:
    """Settings of a job from parsed arguments; raises SettingError for values outside their range."""
    from ...operators.importance import Importance
    from ...operators.scene.placements import SELECTED, VISIBLE
    from ...operators.settings.job_settings import JobSettings

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


def _depth(text: str) -> int | None:
    if text in ("auto", "fit"):
        return None
    if not re.fullmatch(r"[+-]?\d+", text):
        raise SettingError(f"Depth {text!r} is neither a whole number nor 'auto' or 'fit'")
    return int(bounds.DEPTH.read(text))
