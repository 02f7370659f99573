# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments of a job, which several sub-commands share, and the settings that they give."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ...patchnet_addon.runtime.quantities import error_text
from ...patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from .arguments import add_device, add_number

if TYPE_CHECKING:
    from ...operators.importance.painted import Importance
    from ...operators.settings.job_settings import JobSettings
if TYPE_CHECKING:
    from ...operators.settings.cycles_settings import CyclesSettings


def add_settings(parser: argparse.ArgumentParser, *names: str) -> None:
    """Arguments of settings of the table, by their names there."""
    from ...operators.schema.setting import Kind
    from ...operators.schema.table import TABLE

    for row in (TABLE[name] for name in names):
        if row.kind is Kind.SWITCH and row.default:  # with a --no-... beside it
            text = f"{row.help} (on)"
            parser.add_argument(row.argument, action=argparse.BooleanOptionalAction, default=True, help=text)
        elif row.kind is Kind.SWITCH:
            parser.add_argument(row.argument, action="store_true", help=row.help)
        elif row.kind is Kind.CHOICE:
            values, default = [value.lower() for value, _, _ in row.choices], row.default.lower()
            parser.add_argument(row.argument, choices=values, default=default, help=f"{row.help} ({default})")
        elif row.kind is Kind.FILE:
            parser.add_argument(row.argument, type=Path, help=row.help)
        elif row.bounds is None:
            parser.add_argument(row.argument, default="", metavar=row.unit or None, help=row.help)
        elif row.default is None:
            add_number(parser, row.argument, row.bounds, metavar=row.unit or None, help=row.help)
        else:
            add_number(parser, row.argument, row.bounds, default=row.default, help=f"{row.help} ({row.default:g})")


def add_job_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of a job, which `patchnet demo` shares."""
    parser.add_argument(
        "--depth", default="auto",
        help="octree depth; auto: 95 %% look-ahead for all cameras; fit: fine only where the cameras look (auto)",
    )  # fmt: skip
    add_settings(parser, "track", "memory")
    add_number(
        parser, "--voxel-size", bounds.VOXEL_SIZE, help="side of the finest voxels in world units, instead of a depth"
    )
    add_settings(parser, "light", "samples", "denoise", "texel_voxels", "exposure", "cameras")
    add_number(
        parser, "--size", bounds.SIZE_PX, nargs=2, default=(192, 192), metavar=("W", "H"),
        help="pixels of the pictures; a 0 follows the render aspect, 0 0 is the render resolution (192 192)",
    )  # fmt: skip
    add_settings(
        parser,
        "color",
        "both_sides",
        "gloss",
        "device",
        "budget",
        "refined_samples",
        "spp",
        "reference",
    )
    costs = ", ".join(f"{item.name} ({item.cost})" for item in STRATEGIES.values())
    parser.add_argument("--strategy", default=DEFAULT, help=f"what is refined first ({DEFAULT}): {costs}")
    add_settings(parser, "unrefined", "background")
    parser.add_argument(
        "--mask", type=Path, metavar="IMAGE",
        help="painted importance, stretched over each view: multiplies the priority, black is never refined",
    )  # fmt: skip
    add_settings(parser, "importance_image", "importance_group", "heatmap_maximum")
    parser.add_argument("--colormap", default="viridis", help="viridis or turbo (viridis)")
    add_settings(parser, "weights")
    add_device(parser, "what the network makes codes on; auto: a GPU where torch has one (auto)")
    add_cycles(parser)


def require_blender() -> None:
    """Raise PatchNetError that says what to install if Blender is not there as a Python module."""
    from .quiet import quiet_import

    try:
        with quiet_import():
            import bpy  # noqa: F401
    except ImportError as cause:
        raise PatchNetError(
            f"Blender is not there as a Python module ({cause}): install patchnet-blender[blender] and the system "
            "libraries that README names"
        ) from cause
    from ...operators.scene_access.temporary import session_folder_goes

    session_folder_goes()


def job_settings(args: argparse.Namespace, out: Path) -> JobSettings:
    """Settings of a job from parsed arguments; raises SettingError for values outside their range."""
    from ...operators.schema.table import SELECTED, VISIBLE
    from ...operators.settings.job_settings import JobSettings

    return JobSettings.of(
        **given_settings(args),
        scope=SELECTED if getattr(args, "scope", "visible") == "selected" else VISIBLE,
        depth=depth_of(args.depth),
        voxel_size_world=args.voxel_size,
        fit=args.depth == "fit",
        size=tuple(args.size),
        strategy=args.strategy,
        network_device=args.device,
        colormap=args.colormap,
        out=out,
        cycles=cycles_settings(args),
        importance=_importance(args),
    )


def _importance(args: argparse.Namespace) -> Importance | None:
    """Source of painted importance, if one was given; raises SettingError for more than one."""
    from ...operators.importance.painted import Importance

    if args.mask is None and not args.mask_image and not args.mask_group:
        return None
    if args.mask is not None and not args.mask.is_file():  # an error now, not after the bake
        raise SettingError(f"The importance mask {args.mask} does not exist")
    return Importance(args.mask_image, None if args.mask is None else args.mask.absolute(), args.mask_group)


def given_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Values of the arguments of `add_settings` that there are, by their flat names in `JobSettings`."""
    from ...operators.schema.setting import Kind
    from ...operators.schema.table import IMPORTANCE, TABLE

    found = {}
    for row in TABLE.values():
        name = row.argument.removeprefix("--").replace("-", "_")
        if not name or not hasattr(args, name) or row.stage == IMPORTANCE:  # whose sources are one value together
            continue
        value = getattr(args, name)
        if row.name == "memory" and value is not None:
            value = round(value * 2**30)
        elif row.kind is Kind.CHOICE:
            value = next(choice for choice, _, _ in row.choices if choice.lower() == value)
        elif row.kind is Kind.TEXT:
            value = tuple(part.strip() for part in value.split(",") if part.strip())
        found[row.job_field] = value
    return found


def depth_of(text: str) -> int | None:
    """Depth that was given, None for auto and fit; raises SettingError for what is neither."""
    if text in ("auto", "fit"):
        return None
    if not re.fullmatch(r"[+-]?\d+", text):
        raise SettingError(f"Depth {text!r} is neither a whole number nor 'auto' or 'fit'")
    return int(bounds.DEPTH.read(text))


_TITLES = {
    "preview": "preview",
    "predicted": "predicted",
    "refined_octree": "refined octree",
    "composited": "Cycles over unrefined",
    "composited_over_refined_octree": "Cycles over refined",
    "full": "full Cycles render",
}


def add_cycles(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that begin with --cycles."""
    group = parser.add_argument_group("pixels by Cycles")
    add_number(
        group,
        "--cycles-budget",
        bounds.CYCLES_BUDGET,
        metavar="SHARE",
        help="share of pixels that Cycles renders, the worst (none)",
    )
    add_number(
        group, "--cycles-samples", bounds.CYCLES_SAMPLES, default=64, metavar="N", help="samples of these pixels (64)"
    )
    group.add_argument(
        "--cycles-light", choices=("diffuse", "combined"), default="diffuse",
        help="what they show: as the voxels, or with gloss and glass (diffuse)",
    )  # fmt: skip
    group.add_argument(
        "--cycles-compare", action="store_true", help="measure time and error against a full render by Cycles"
    )


def cycles_settings(args: argparse.Namespace) -> CyclesSettings | None:
    """Read the settings, None unless a budget was given; raises SettingError for values outside their range."""
    from ...operators.settings.cycles_settings import CyclesSettings
    from ...patchnet_addon.runtime.errors import SettingError

    if args.cycles_budget is None:
        if args.cycles_compare:
            raise SettingError("--cycles-compare needs pixels to compare: give --cycles-budget")
        return None
    return CyclesSettings(
        args.cycles_budget,
        args.cycles_samples,
        args.cycles_light,
        args.cycles_compare,
    )


def print_cycles(report: dict[str, Any] | None) -> None:
    """Print a view's figures of pixels by Cycles, if it has any."""
    if report is None:
        return
    seconds = report["seconds"]
    text = f"Cycles on {report['pixels_share']:.1%} of pixels: "
    text += f"{seconds['pixels']:.1f} s, {seconds['of_that_reading_the_scene']:.1f} s of that reading the scene"
    print(text + (f"; full render {seconds['full']:.1f} s" if "full" in seconds else ""))
    for name, value in report.get("mse", {}).items():
        print(f"  {_TITLES[name]:<24} {error_text(value):>6}")
