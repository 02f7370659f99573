# SPDX-License-Identifier: GPL-3.0-or-later
"""Job arguments shared by several sub-commands, and their settings."""

from __future__ import annotations

import argparse
import re
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ...patchnet_addon.sampling.registry import DEFAULT
from .arguments import add_device, add_number, is_given
from .lines import say_note

if TYPE_CHECKING:
    from ...operators.importance.painted import Importance
    from ...operators.schema.setting import Setting
    from ...operators.settings.cycles_settings import CyclesSettings
    from ...operators.settings.job_settings import JobSettings


_TRACK = re.compile(r"(-?\d+)-(-?\d+)")


def add_settings(parser: argparse._ActionsContainer, *stages: str, without: Collection[str] = ()) -> None:
    """Add the arguments for the settings of some stages, in the order of the table, `without` those of some names."""
    from ...operators.settings.job_settings import rows

    for row in rows(*stages):
        if row.name not in without:
            add_setting(parser, row)


def add_setting(parser: argparse._ActionsContainer, row: Setting) -> None:
    """Add the argument for a setting, if it has one."""
    from ...operators.schema.setting import Kind

    flag, text = row.flag, row.help or row.description
    if not flag:
        return
    if row.name in _FORMS:
        parser.add_argument(flag, help=text, **_FORMS[row.name])
    elif row.name == "network_device":
        add_device(parser, text)
    elif row.kind is Kind.SWITCH and row.default:  # with its --no-... form
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
    elif row.kind is Kind.PAIR:  # square pictures, while the panel's follow the render's aspect
        add_number(parser, flag, row.bounds, text, (192, 192), metavar=("W", "H"))
    else:
        add_number(parser, flag, row.bounds, text, row.default, metavar=row.unit or None)


# Arguments that take other values than the properties of their settings.
_FORMS: dict[str, dict[str, Any]] = {
    "depth": {"default": "auto"},
    "track": {"nargs": "?", "const": "", "metavar": "FIRST-LAST"},
    "strategy": {"default": DEFAULT},
}


def add_job_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a job, shared with `patchnet demo`, in the order of the settings."""
    from ...operators.schema.values import JOB, REFINEMENT

    add_settings(parser, *JOB)
    parser.add_argument("--colormap", default="viridis", help="viridis or turbo (viridis)")
    group = parser.add_argument_group("pixels by Cycles")
    text = "share of pixels, those of highest priority, that Cycles renders (none)"
    add_number(group, "--cycles-budget", bounds.CYCLES_BUDGET, text, metavar="SHARE")
    add_settings(group, REFINEMENT, without=("cycles_budget",))
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


def job_settings(args: argparse.Namespace, out: Path) -> JobSettings:
    """Settings of a job from parsed arguments; raises SettingError for values outside their range."""
    from ...operators.schema.values import JOB, SELECTED, VISIBLE
    from ...operators.settings.job_settings import JobSettings

    if args.spp is not None and is_given(args, "--refined-samples"):
        raise SettingError("--spp and --refined-samples exclude each other: omit one of them")
    return JobSettings.of(
        **given_settings(args, *JOB),
        scope=SELECTED if getattr(args, "scope", "visible") == "selected" else VISIBLE,
        colormap=args.colormap,
        out=out,
        cycles=_cycles_settings(args),
        importance=_importance(args),
    )


def _importance(args: argparse.Namespace) -> Importance | None:
    """Source of painted importance, if given; raises SettingError for both."""
    from ...operators.importance.painted import Importance

    return Importance(args.mask_image, args.mask_group) if args.mask_image or args.mask_group else None


def given_settings(args: argparse.Namespace, *stages: str) -> dict[str, Any]:
    """Values of the arguments for settings of some stages, by their names; notes those without effect."""
    from ...operators.schema.setting import Kind
    from ...operators.schema.values import IMPORTANCE, LIGHT
    from ...operators.settings.job_settings import rows

    found: dict[str, Any] = {}
    for row in rows(*stages):
        name = row.flag.removeprefix("--").replace("-", "_")
        if not hasattr(args, name) or row.stage == IMPORTANCE:  # whose arguments form one value
            continue
        if row.stage == LIGHT and not row.counts(args) and is_given(args, row.flag):
            say_note(f"{row.flag} has no effect with --light {args.light}")
        value = getattr(args, name)
        if row.name == "track":
            found |= track_of(value)
            continue
        if row.name == "depth":
            value = depth_of(value)
        elif row.kind is Kind.CHOICE and row.check is None:
            value = next(choice for choice, _, _ in row.choices if choice.lower() == value)
        elif row.kind is Kind.TEXT:
            value = tuple(part.strip() for part in value.split(",") if part.strip())
        elif row.kind is Kind.PAIR:
            value = tuple(value)
        found[row.name] = value
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
    from ...operators.schema.setting import names_of
    from ...operators.settings.cycles_settings import CyclesSettings

    given = {field: getattr(args, name) for name, field in names_of(CyclesSettings).items()}
    given = {name: value for name, value in given.items() if value is not None and value is not False}
    if args.cycles_budget is not None:
        return CyclesSettings(**given)
    if given:
        raise SettingError(f"--cycles-{next(iter(given))} requires --cycles-budget: add it")
    return None
