# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that adds the courtyard as a scene of the open file, to try things on."""

from __future__ import annotations

import bpy

from .jobs.polls import in_object_mode, no_job_runs
from .jobs.tell import tell, tell_start

NAME = "PatchNet Courtyard"


class PATCHNET_OT_add_demo_scene(bpy.types.Operator):
    """Build a courtyard with cameras and light in a new scene of this file, and select its objects; other scenes stay
    as they are"""

    bl_idname = "patchnet.add_demo_scene"
    bl_label = "PatchNet Demo Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require that no job runs on the present scene, and a mode in which scenes can be added."""
        return in_object_mode(cls, context, "A scene can be added") and no_job_runs(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build it, and show it in this window."""
        from .demo_scene import build_courtyard

        tell_start(self)
        scene = bpy.data.scenes.new(NAME)
        build_courtyard(scene)
        if context.window is not None:
            context.window.scene = scene
        layer = scene.view_layers[0]
        layer.update()  # objects that it does not know yet would forget that they are selected
        for item in layer.objects:
            item.select_set(True, view_layer=layer)
        tell(self, "INFO", f"{len(scene.objects)} objects in scene '{scene.name}', seen by 3 cameras")
        return {"FINISHED"}


def _draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    menu.layout.operator(PATCHNET_OT_add_demo_scene.bl_idname, icon="HOME")


def register() -> None:
    """Register the operator, and its entry in the viewport's menu Add."""
    bpy.utils.register_class(PATCHNET_OT_add_demo_scene)
    bpy.types.VIEW3D_MT_add.append(_draw_in_menu)


def unregister() -> None:
    """Take both away."""
    bpy.types.VIEW3D_MT_add.remove(_draw_in_menu)
    bpy.utils.unregister_class(PATCHNET_OT_add_demo_scene)
