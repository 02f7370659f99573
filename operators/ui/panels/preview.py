# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the preview: cameras, strategy, budget, and painted importance."""

from __future__ import annotations

import bpy

from ...session import results
from .advice import advice
from .notes import draw_todo
from .tab import SubPanel, Tab, draw_samples, draw_sentence, draw_setting, draw_settings, draw_stale, split


class PATCHNET_PT_preview(SubPanel, bpy.types.Panel):
    """A view, where it is wrong, and what refining makes of it."""

    bl_label = "Preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, the button, and advice on the picture."""
        layout = split(self.layout)
        values = context.scene.patchnet
        for name in ("cameras", "strategy", "unrefined", "background"):
            draw_setting(layout, values, name)
        draw_samples(layout, values)
        for name in ("heatmap_maximum", "out"):
            draw_setting(layout, values, name)
        layout.operator("patchnet.render_preview", icon="RENDER_STILL")
        draw_stale(layout, context, "view")
        result = results.result_of(context.scene)
        if result is not None and result.pictures:
            for text in advice(result, values):
                draw_todo(layout.box(), context, text, "LIGHT_DATA")


class PATCHNET_PT_importance(Tab, bpy.types.Panel):
    """Painted importance."""

    bl_label = "Importance"
    bl_parent_id = "PATCHNET_PT_preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the source, and its name."""
        layout = split(self.layout)
        draw_settings(layout, context.scene.patchnet, "importance")
        if context.scene.patchnet.importance != "NONE":
            draw_sentence(layout, context, "Black or weight 0 is never refined", "INFO")


CLASSES = (PATCHNET_PT_preview, PATCHNET_PT_importance)
