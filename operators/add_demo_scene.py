# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that adds the courtyard as a scene of the open file, to try things on."""

from __future__ import annotations

import bpy

from ..patchnet_addon.process.computed import computed
from ..patchnet_addon.runtime.progress import Progress, Steps
from .computing.demo_textures import courtyard_pictures
from .jobs.job_operator import JobOperator, in_object_mode
from .settings.job_settings import JobSettings

NAME = "PatchNet Courtyard"


class PATCHNET_OT_add_demo_scene(JobOperator, bpy.types.Operator):
    """Add a courtyard with lights and three cameras as a new scene, select its objects, and look through a camera"""

    bl_idname = "patchnet.add_demo_scene"
    bl_label = "PatchNet Demo Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require that no job runs on the present scene, and a mode in which scenes can be added."""
        return in_object_mode(cls, context, "A scene can be added") and super().poll(context)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Build the courtyard and show it in this window."""
        from .demo_scene import build_courtyard, streams

        pictures = yield from computed(courtyard_pictures, streams()[0], at=Progress(0, 1, "Painting textures"))
        scene = bpy.data.scenes.new(NAME)
        build_courtyard(scene, pictures=pictures)
        layer = scene.view_layers[0]
        layer.update()  # else new objects lose their selection
        for item in layer.objects:
            item.select_set(True, view_layer=layer)
        if context.window is not None:
            context.window.scene = scene
            _look_through_camera(context.window.screen)
        return f"{len(scene.objects)} objects in scene '{scene.name}', seen by 3 cameras"


def _look_through_camera(screen: bpy.types.Screen) -> None:
    """Show the scene's whole camera view in the largest 3D viewport."""
    viewports = [area for area in screen.areas if area.type == "VIEW_3D"]
    for area in sorted(viewports, key=lambda area: area.width * area.height)[-1:]:
        view = area.spaces.active.region_3d
        view.view_perspective, view.view_camera_zoom, view.view_camera_offset = "CAMERA", 0.0, (0.0, 0.0)


def _draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    menu.layout.operator(PATCHNET_OT_add_demo_scene.bl_idname, icon="HOME")


MENUS = (("VIEW3D_MT_add", _draw_in_menu),)
