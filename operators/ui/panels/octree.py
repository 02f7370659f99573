# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of the octree: objects and resolution."""

from __future__ import annotations

import bpy

from .tab import SubPanel, draw_settings, draw_stale, split


class PATCHNET_PT_octree(SubPanel, bpy.types.Panel):
    """Octree: which objects become voxels, and how fine ones."""

    bl_label = "Octree"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, the button, what does not fit."""
        layout = split(self.layout)
        draw_settings(layout, context.scene.patchnet, "octree")
        row = layout.row(align=True)
        row.operator("patchnet.voxelize", icon="MESH_GRID")
        row.operator("patchnet.load_octree", text="", icon="FILEBROWSER")
        draw_stale(layout, context, "surface")


CLASSES = (PATCHNET_PT_octree,)
