# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of shown and exported voxels."""

from __future__ import annotations

from bpy.props import EnumProperty

from ....patchnet_addon.runtime.bounds import LEVEL, SHOWN_VOXELS
from ...voxel_object import CUBES, POINTS
from .shapes import OF_ONE_CALL, number


class LevelProperties:
    """Level that is shown or exported."""

    level: number(
        "Level",
        "Level of the voxels, each half as large as on the one before; 0 takes the finest",
        0,
        LEVEL,
        options=OF_ONE_CALL,
    )


class DisplayProperties(LevelProperties):
    """Voxels in the scene. Operators forget these values, so that those of the panel count for each call."""

    display: EnumProperty(
        name="Display",
        description="What stands for a voxel",
        items=[
            (CUBES, "Cubes", "A cube of the voxel's size"),
            (POINTS, "Points", "A sphere that fits into the voxel: lighter to draw, but gray in Solid shading"),
        ],
        default=CUBES,
        options=OF_ONE_CALL,
    )
    limit: number(
        "Limit",
        "Voxels at most: where a level has more, a coarser one is shown",
        200_000,
        SHOWN_VOXELS,
        soft_max=5_000_000,
        options=OF_ONE_CALL,
    )
