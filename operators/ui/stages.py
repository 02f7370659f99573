# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of a job's stages before the picture: octree, light and animation, network."""

from __future__ import annotations

import bpy

from ..schema.table import CYCLES, GLOSS_OFF
from ..session import results
from .tab import (
    SubPanel,
    Tab,
    changed_text,
    draw_advanced,
    draw_sentence,
    draw_setting,
    draw_settings,
    draw_stale,
    split,
)  # fmt: skip


class PATCHNET_PT_octree(SubPanel, bpy.types.Panel):
    """Octree: its objects and its resolution."""

    bl_label = "Octree"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, and why voxels are out of date."""
        layout = split(self.layout)
        draw_settings(layout, context.scene.patchnet, "octree")
        layout.operator("patchnet.voxelize", icon="MESH_GRID")
        layout.operator("patchnet.load_octree", icon="FILEBROWSER")
        draw_stale(layout, context, "surface")
        draw_advanced(layout, context.scene.patchnet, "octree")


class PATCHNET_PT_light(SubPanel, bpy.types.Panel):
    """Light of the voxels and its source."""

    bl_label = "Light"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, and limits of the bake."""
        layout = split(self.layout)
        draw_settings(layout, context.scene.patchnet, "light")
        layout.operator("patchnet.bake_light", icon="LIGHT")
        draw_stale(layout, context, "light")
        if context.scene.patchnet.light == CYCLES and context.scene.patchnet.gloss == GLOSS_OFF:
            draw_sentence(layout, context, "Diffuse light only, no gloss", "INFO")
        draw_advanced(layout, context.scene.patchnet, "light")


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


class PATCHNET_PT_network(SubPanel, bpy.types.Panel):
    """Network for look-ahead."""

    bl_label = "Network"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, and the name of the encoder that made the codes."""
        layout = split(self.layout)
        draw_settings(layout, context.scene.patchnet, "codes")
        layout.operator("patchnet.precompute_codes", icon="NODETREE")
        result = results.result_of(context.scene)
        if result is None or result.coded is None:
            return
        if result.encoder:
            draw_sentence(layout, context, f"Prepared by {result.encoder}", "INFO")
        if why := changed_text(context.scene.patchnet, result.made_with.get("codes"), "codes"):
            draw_sentence(layout, context, f"{why}: prepare again", "ERROR")
