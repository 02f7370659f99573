# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of voxelization: objects and resolution."""

from __future__ import annotations

from bpy.props import BoolProperty, EnumProperty

from ....patchnet_addon.runtime.bounds import DEPTH, MEMORY_GIB, VOXEL_SIZE
from ...scene.placements import SELECTED, VISIBLE
from .shapes import automatic_at_zero, number


class VoxelizeProperties:
    """What is voxelized, and how finely."""

    scope: EnumProperty(
        name="Objects",
        description="Which objects are voxelized",
        items=[
            ("AUTO", "Automatic", "Selected objects in a window, all visible ones in background"),
            (SELECTED, "Selected", "Selected objects"),
            (VISIBLE, "Visible", "All objects that are visible and rendered"),
        ],
        default="AUTO",
    )
    resolution: EnumProperty(
        name="Resolution",
        description="How the side of the finest voxels is found",
        items=[
            ("AUTO", "By Cameras", "The smallest depth at which the cameras see two levels ahead nearly everywhere"),
            ("FIT", "Fit to Cameras", "Fine only where cameras see the surface, coarse elsewhere: for large pictures"),
            ("DEPTH", "Depth", "A number of levels: every level halves the voxels"),
            ("VOXEL_SIZE", "Voxel Size", "A length in the scene's units"),
        ],
        default="AUTO",
    )
    depth: number("Depth", "Levels of the octree", 9, DEPTH)
    voxel_size: number("Voxel Size", "Side of the finest voxels", 0.01, VOXEL_SIZE, unit="LENGTH", precision=4)
    track: BoolProperty(
        name="Whole Animation",
        description="Fit the voxels to the cameras at all frames of the scene, not only at the present one",
        default=False,
    )
    memory: automatic_at_zero(
        "Memory Limit",
        "GiB that the octree may take while it is built; 0 takes what is free",
        MEMORY_GIB,
        soft_max=64.0,
    )
