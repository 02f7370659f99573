# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the stages of a job, which scenes and operators mix in; declared in the table of settings."""

from __future__ import annotations

from typing import Any

from bpy.props import BoolProperty, EnumProperty

from ...patchnet_addon.runtime.bounds import FRAME, FRAME_STEP, LEVEL, SHOWN_VOXELS, Bounds
from ..schema.table import CAMERAS, CODES, IMPORTANCE, LIGHT, OCTREE, OUTPUT, REFINEMENT, RENDERS, VIEW
from ..voxel_object import CUBES, POINTS
from .shapes import OF_ONE_CALL, number, properties_of


class VoxelizeProperties:
    """Octree: what is voxelized, and how finely."""

    __annotations__ = properties_of(OCTREE)


class LightProperties:
    """Light: where luminance comes from."""

    __annotations__ = properties_of(LIGHT)


class CodesProperties:
    """Network that looks ahead."""

    __annotations__ = properties_of(CODES)


class CameraProperties:
    """Cameras: whose pictures are made, and how large."""

    __annotations__ = properties_of(CAMERAS)


class ViewProperties:
    """View: what is refined first, what matters to the user, and how it is shown."""

    __annotations__ = properties_of(VIEW, IMPORTANCE)


class CyclesRefineProperties:
    """Refinement of a preview with Cycles."""

    __annotations__ = properties_of(REFINEMENT)


class RenderProperties:
    """Renders of the engine."""

    __annotations__ = properties_of(RENDERS)


class OutputProperties:
    """Output: where files go."""

    __annotations__ = properties_of(OUTPUT)


class JobProperties(
    VoxelizeProperties, LightProperties, CodesProperties, CameraProperties, ViewProperties, OutputProperties
):
    """All settings of a job."""


class AnimationProperties:
    """Animation: how its frames are baked."""

    skip_existing: BoolProperty(
        name="Skip Finished",
        description="Keep frames whose files are complete and up to date, instead of baking them again",
        default=True,
    )
    same_grid: BoolProperty(
        name="Same Voxel Grid",
        description="Keep voxels at the same places and of the same size at all frames, so that pictures do not "
        "flicker; reads the scene at all frames first",
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


class LevelProperties:
    """Level that is shown or exported."""

    level: number(
        "Level (0 Finest)",  # read in Adjust Last Operation and the file browser; the panel has a checkbox
        "Level of the voxels, each half as large as on the one before; 0 takes the finest",
        0,
        LEVEL,
        options=OF_ONE_CALL,
    )


class DisplayProperties(LevelProperties):
    """Voxels in the scene. Operators forget these values, so that those of the panel count for each call."""

    display: EnumProperty(
        name="Display",
        description="Shape of a shown voxel",
        items=[
            (CUBES, "Cubes", "A cube of the voxel's size"),
            (POINTS, "Points", "A sphere that fits into the voxel: lighter to draw, but gray in Solid shading"),
        ],
        default=CUBES,
        options=OF_ONE_CALL,
    )
    limit: number(
        "Voxel Limit",
        "Most voxels to show; a higher limit shows finer levels and draws slower",
        200_000,
        SHOWN_VOXELS,
        soft_max=5_000_000,
        options=OF_ONE_CALL,
    )
