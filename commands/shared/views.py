# SPDX-License-Identifier: GPL-3.0-or-later
"""Views for `--depth auto` of `patchnet octree`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SettingError
from .arguments import add_number

if TYPE_CHECKING:
    from ...patchnet_addon.tracing.camera import Camera


def add_views(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the views for `--depth auto`."""
    text = "with --depth auto: position and target of a camera of 50 degrees, in world units; may be repeated"
    axes = ("X", "Y", "Z", "TX", "TY", "TZ")
    add_number(parser, "--view", bounds.COORDINATE, text, nargs=6, action="append", metavar=axes)
    parser.set_defaults(view=[])
    add_number(parser, "--size", bounds.VIEW_PX, "pixels of the views", (1920, 1080))
    add_number(parser, "--memory", bounds.MEMORY_GIB, "memory limit with --depth auto (all free memory)", metavar="GIB")


def view_cameras(args: argparse.Namespace) -> list[Camera]:
    """Cameras of `add_views`."""
    from ...patchnet_addon.tracing.camera import Camera

    width, height = args.size
    for values in args.view:
        if values[:3] == values[3:]:
            raise SettingError(
                f"--view {' '.join(f'{value:g}' for value in values)} has its target at its position: move the target"
            )
    return [
        Camera.look_at(np.array(values[:3]), np.array(values[3:]), size_px=(width, height), name=f"View {number}")
        for number, values in enumerate(args.view, 1)
    ]
