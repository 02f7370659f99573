# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the preview: cameras, strategy, budget, and painted importance."""

from __future__ import annotations

import bpy

from ...session import results
from .advice import Advice, advice
from .tab import SubPanel, Tab, draw_samples, draw_sentence, draw_setting, draw_settings, draw_stale, split


class PATCHNET_PT_preview(SubPanel, bpy.types.Panel):
    """A view, where it is wrong, and what refining makes of it."""

    bl_label = "Preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, the button, where pictures are."""
        layout = split(self.layout)
        values = context.scene.patchnet
        for name in ("cameras", "strategy", "unrefined", "background"):
            draw_setting(layout, values, name)
        draw_samples(layout, values)
        for name in ("heatmap_maximum", "out"):
            draw_setting(layout, values, name)
        layout.operator("patchnet.render_preview", icon="RENDER_STILL")
        draw_stale(layout, context.scene, "view")
        result = results.result_of(context.scene)
        if result is not None and result.pictures:
            layout.label(text="Pictures: see an Image Editor", icon="IMAGE_DATA")
            for item in advice(result, values):
                _draw_advice(layout, context, item)


def _draw_advice(layout: bpy.types.UILayout, context: bpy.types.Context, item: Advice) -> None:
    """Draw a sentence, and the button that does what it says."""
    box = layout.box()
    draw_sentence(box, context, item.text, "LIGHT_DATA")
    if item.setting:
        button = box.operator("wm.context_set_enum", text=item.button)
        button.data_path, button.value = f"scene.patchnet.{item.setting}", item.value


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
            layout.label(text="Black or weight 0 is never refined", icon="INFO")


CLASSES = (PATCHNET_PT_preview, PATCHNET_PT_importance)
