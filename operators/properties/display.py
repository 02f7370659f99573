# SPDX-License-Identifier: GPL-3.0-or-later
"""Which voxels are shown or exported."""

from __future__ import annotations

from bpy.props import EnumProperty, IntProperty

from ...patchnet_addon.octree.grid import MAX_DEPTH
from ..voxel_object import CUBES, POINTS
from .shapes import OF_ONE_CALL


class LevelProperties:
    """Which level is shown or exported."""

    level: IntProperty(
        name="Level",
        description="Level of the voxels, each half as large as on the one before; 0 takes the finest",
        default=0,
        min=0,
        max=MAX_DEPTH,
        options=OF_ONE_CALL,
    )


class DisplayProperties(LevelProperties):
    """How voxels are shown in the scene. Operators forget them, so that the panel's values count for each call."""

    display: EnumProperty(
        name="Display",
        description="What stands for a voxel",
        items=[
            (CUBES, "Cubes", "A cube of the voxel's size"),
            (POINTS, "Points", "A sphere that fits into the voxel: lighter to draw"),
        ],
        default=CUBES,
        options=OF_ONE_CALL,
    )
    limit: IntProperty(
        name="Limit",
        description="Voxels at most: where a level has more, a coarser one is shown",
        default=200_000,
        min=1,
        soft_max=5_000_000,
        options=OF_ONE_CALL,
    )
