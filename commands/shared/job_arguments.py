# SPDX-License-Identifier: GPL-3.0-or-later
"""Job arguments shared by several sub-commands, and their settings."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ...patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from .arguments import add_device, add_number, is_given
from .lines import say_note

if TYPE_CHECKING:
    from ...operators.importance.painted import Importance
    from ...operators.settings.cycles_settings import CyclesSettings
    from ...operators.settings.job_settings import JobSettings


_TRACK = re.compile(r"(-?\d+)-(-?\d+)")


def add_settings(parser: argparse._ActionsContainer, *names: str) -> None:
    """Add arguments for settings, by their names in the table."""
    from ...operators.schema.setting import Kind
    from ...operators.schema.table import CYCLES_TABLE, TABLE

    for row in ((TABLE | CYCLES_TABLE)[name] for name in names):
        flag, text = row.argument or f"--{row.name.replace('_', '-')}", row.help or row.description
        if row.kind is Kind.SWITCH and row.default:  # with its --no-... form
            parser.add_argument(flag, action=argparse.BooleanOptionalAction, default=True, help=f"{text} (on)")
        elif row.kind is Kind.SWITCH:
            parser.add_argument(flag, action="store_true", help=text)
        elif row.kind is Kind.CHOICE:
            values, default = [value.lower() for value, _, _ in row.choices], row.default.lower()
            parser.add_argument(flag, choices=values, default=default, help=f"{text} ({default})")
        elif row.kind is Kind.FILE:
            parser.add_argument(flag, type=Path, help=text)
        elif row.bounds is None:
            parser.add_argument(flag, default="", metavar=row.unit or None, help=text)
        else:
            add_number(parser, flag, row.bounds, text, row.default, metavar=row.unit or None)


def add_job_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a job, shared with `patchnet demo`."""
    parser.add_argument(
        "--depth", default="auto", help="octree depth; auto: fine where the cameras look, coarse elsewhere (auto)"
    )
    parser.add_argument(
        "--track", nargs="?", const="", metavar="FIRST-LAST",
        help="with --depth auto: the cameras at all frames of the scene as saved, or at those from FIRST to LAST",
    )  # fmt: skip
    add_settings(parser, "shape", "memory")
    add_number(
        parser, "--voxel-size", bounds.VOXEL_SIZE, "side of the finest voxels in world units, instead of a depth"
    )
    add_settings(parser, "light", "noise_threshold", "max_samples", "cells", "denoise", "exposure", "cameras")
    text = "pixels of the pictures; a 0 follows the render aspect, 0 0 is the render resolution"
    add_number(parser, "--size", bounds.SIZE_PX, text, (192, 192), metavar=("W", "H"))
    add_settings(parser, "color", "sides", "gloss", "device")
    add_settings(parser, "budget", "refined_samples", "spp", "reference")
    costs = ", ".join(f"{item.name} ({item.cost})" for item in STRATEGIES.values())
    parser.add_argument("--strategy", default=DEFAULT, help=f"order of refinement ({DEFAULT}): {costs}")
    add_settings(parser, "unrefined", "background")
    add_settings(parser, "importance_image", "importance_group", "heatmap_maximum")
    parser.add_argument("--colormap", default="viridis", help="viridis or turbo (viridis)")
    add_settings(parser, "weights")
    add_device(parser, "device of the network's encoder; auto: a GPU if torch has one (auto)")
    group = parser.add_argument_group("pixels by Cycles")
    text = "share of pixels, those of highest priority, that Cycles renders (none)"
    add_number(group, "--cycles-budget", bounds.CYCLES_BUDGET, text, metavar="SHARE")
    add_settings(group, "cycles_samples", "cycles_light", "cycles_compare")
    group.set_defaults(cycles_samples=None, cycles_light=None)  # those of CyclesSettings


def require_blender() -> None:
    """Raise PatchNetError with the command to install Blender as a Python module, if it is missing."""
    from .quiet import quiet_import

    try:
        with quiet_import():
            import bpy  # noqa: F401
    except ImportError as cause:
        raise PatchNetError(
            f"Blender is not there as a Python module ({cause}): install patchnet-blender[blender] and the system "
            "libraries that docs/command-line.md names"
        ) from cause
    from ...operators.scene_access.temporary import session_folder_goes

    session_folder_goes()


def job_settings(args: argparse.Namespace, out: Path) -> JobSettings:
    """Settings of a job from parsed arguments; raises SettingError for values outside their range."""
    from ...operators.schema.table import SELECTED, VISIBLE
    from ...operators.settings.job_settings import JobSettings

    if args.spp is not None and is_given(args, "--refined-samples"):
        raise SettingError("--spp and --refined-samples exclude each other: omit one of them")
    return JobSettings.of(
        **given_settings(args),
        **track_of(args.track),
        scope=SELECTED if getattr(args, "scope", "visible") == "selected" else VISIBLE,
        depth=depth_of(args.depth),
        voxel_size_world=args.voxel_size,
        size=tuple(args.size),
        strategy=args.strategy,
        network_device=args.device,
        colormap=args.colormap,
        out=out,
        cycles=_cycles_settings(args),
        importance=_importance(args),
    )


def _importance(args: argparse.Namespace) -> Importance | None:
    """Source of painted importance, if given; raises SettingError for both."""
    from ...operators.importance.painted import Importance

    return Importance(args.mask_image, args.mask_group) if args.mask_image or args.mask_group else None


def given_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Values of the arguments of `add_settings`, by their flat names in `JobSettings`; notes those without effect."""
    from ...operators.schema.setting import Kind
    from ...operators.schema.table import IMPORTANCE, LIGHT, TABLE

    found = {}
    for row in TABLE.values():
        name = row.argument.removeprefix("--").replace("-", "_")
        if not name or not hasattr(args, name) or row.stage == IMPORTANCE:  # sources form one value
            continue
        if row.stage == LIGHT and not row.counts(args) and is_given(args, row.argument):
            say_note(f"{row.argument} has no effect with --light {args.light}")
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
    """Parse a depth, None for "auto"; raises SettingError."""
    if text == "auto":
        return None
    if not re.fullmatch(r"[+-]?\d+", text):
        raise SettingError(f"Depth {text!r} is neither a whole number nor 'auto'")
    return int(bounds.DEPTH.read(text))


def track_of(text: str | None) -> dict[str, Any]:
    """Settings of a track: None for none, "" for the scene's frames, else FIRST-LAST; raises SettingError."""
    if not text:
        return {"track": text is not None}
    frames = _TRACK.fullmatch(text)
    if frames is None:
        raise SettingError(f"Track {text!r} is not FIRST-LAST, such as 1-250: write so, or --track after the file")
    return {"track": True, "track_frames": (int(frames[1]), int(frames[2]))}


def _cycles_settings(args: argparse.Namespace) -> CyclesSettings | None:
    """Cycles settings, None without a budget; raises SettingError for values outside their range."""
    from ...operators.settings.cycles_settings import CyclesSettings

    given = {name: getattr(args, f"cycles_{name}") for name in ("budget", "samples", "light", "compare")}
    given = {name: value for name, value in given.items() if value is not None and value is not False}
    if args.cycles_budget is not None:
        return CyclesSettings(**given)
    if given:
        raise SettingError(f"--cycles-{next(iter(given))} requires --cycles-budget: add it")
    return None
