# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the output: folder and files, and the frames that are made."""

from __future__ import annotations

from typing import Any

from bpy.props import BoolProperty

from ....patchnet_addon.runtime.bounds import FRAME, FRAME_STEP, Bounds
from .shapes import OF_ONE_CALL, number


class AnimationProperties:
    """Animation: how its frames are baked."""

    skip_existing: BoolProperty(
        name="Skip Finished",
        description="Leave frames alone whose files are complete and are what would be made again; off makes them anew",
        default=True,
    )
    same_grid: BoolProperty(
        name="Same Grid",
        description="Voxels stand at the same places and have the same size at all frames, so that pictures do not swim"
        ": the scene is read at all frames first",
        default=False,
    )


def _frame(name: str, description: str, default: int, bounds: Bounds = FRAME) -> Any:
    """Property for a frame, or a number of frames; the scene has them already, as its frame range."""
    return number(name, f"{description}; the scene's if it is not given", default, bounds, options=OF_ONE_CALL)


class FrameProperties:
    """Frame range; that of the scene where they are not given."""

    frame_start: _frame("Frame Start", "First frame", 1)
    frame_end: _frame("Frame End", "Last frame", 250)
    frame_step: _frame("Frame Step", "Frames from one to the next", 1, FRAME_STEP)
