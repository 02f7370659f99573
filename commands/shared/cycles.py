# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments and figures of regions that Cycles renders over the preview; no sub-command."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.quantities import counted, error_text
from .arguments import add_number

if TYPE_CHECKING:
    from ...operators.settings.cycles_settings import CyclesSettings

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
    group = parser.add_argument_group("regions by Cycles")
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
    add_number(
        group, "--cycles-tile", bounds.CYCLES_TILE, default=16, metavar="PX", help="side of a region's tiles (16)"
    )
    add_number(group, "--cycles-regions", bounds.CYCLES_REGIONS, default=8, metavar="N", help="regions at most (8)")
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
            raise SettingError("--cycles-compare needs regions to compare: give --cycles-budget")
        return None
    return CyclesSettings(
        args.cycles_budget,
        args.cycles_samples,
        args.cycles_tile,
        args.cycles_regions,
        args.cycles_light,
        args.cycles_compare,
    )


def print_cycles(report: dict[str, Any] | None) -> None:
    """Print a view's figures of regions by Cycles, if it has any."""
    if report is None:
        return
    seconds = report["seconds"]
    text = f"Cycles on {report['pixels_share']:.1%} of pixels in {counted(len(report['regions']), 'region')}: "
    text += f"{seconds['regions']:.1f} s, {seconds['of_that_reading_the_scene']:.1f} s of that reading the scene"
    print(text + (f"; full render {seconds['full']:.1f} s" if "full" in seconds else ""))
    for name, value in report.get("mse", {}).items():
        print(f"  {_TITLES[name]:<24} {error_text(value):>6}")
