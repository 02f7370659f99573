# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of the export: the voxels as an object, and as files."""

from __future__ import annotations

import bpy

from ....patchnet_addon.export.vdb import vdb_module_name
from .tab import SubPanel, draw_sentence, split


class PATCHNET_PT_export(SubPanel, bpy.types.Panel):
    """Voxels in the scene, and for other programs."""

    bl_label = "Export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, the two buttons, and what this Blender cannot write."""
        layout = split(self.layout)
        for name in ("level", "display", "limit"):
            layout.prop(context.scene.patchnet, name)
        layout.operator("patchnet.show_voxels", icon="MESH_CUBE")
        layout.operator("patchnet.export_octree", icon="EXPORT")
        if not vdb_module_name():  # looked for once
            draw_sentence(layout, context, "This Blender cannot write .vdb", "INFO")


CLASSES = (PATCHNET_PT_export,)
