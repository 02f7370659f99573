# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of light and samples, and of the frames of an animation."""

from __future__ import annotations

import bpy

from ...schema.table import CYCLES, GLOSS_OFF
from .tab import SubPanel, Tab, draw_sentence, draw_setting, draw_settings, draw_stale, split


class PATCHNET_PT_light(SubPanel, bpy.types.Panel):
    """Light of the voxels, and where it comes from."""

    bl_label = "Light"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, the button, what baking leaves out."""
        layout = split(self.layout)
        draw_settings(layout, context.scene.patchnet, "light")
        layout.operator("patchnet.bake_light", icon="LIGHT")
        draw_stale(layout, context, "light")
        if context.scene.patchnet.light == CYCLES and context.scene.patchnet.gloss == GLOSS_OFF:
            draw_sentence(layout, context, "Diffuse light only, no gloss", "INFO")


class PATCHNET_PT_animation(Tab, bpy.types.Panel):
    """All frames, each with its own octree and pictures."""

    bl_label = "Animation"
    bl_parent_id = "PATCHNET_PT_light"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the scene's frames, the settings, and the button."""
        layout = split(self.layout)
        column = layout.column(align=True)
        for name, text in (("frame_start", "Frame Start"), ("frame_end", "End"), ("frame_step", "Step")):
            column.prop(context.scene, name, text=text)
        for name in ("skip_existing", "same_grid", "out"):
            draw_setting(layout, context.scene.patchnet, name)
        layout.operator("patchnet.bake_animation", icon="RENDER_ANIMATION")


CLASSES = (PATCHNET_PT_light, PATCHNET_PT_animation)
