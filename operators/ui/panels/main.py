# SPDX-License-Identifier: GPL-3.0-or-later
"""Main panel: the settings that a first user needs, one button that does everything, and the estimate."""

from __future__ import annotations

import bpy

from ...jobs.job_operator import JobOperator
from ...session import results
from ...settings.step_settings import ESTIMATED, changed
from ..presets_menu import PATCHNET_PT_presets
from .tab import Tab, draw_first, draw_stale, split


class PATCHNET_PT_main(Tab, bpy.types.Panel):
    """Everything in one click, and what it will take."""

    bl_label = "PatchNet"

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        """Draw the menu of presets."""
        PATCHNET_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, or progress in its place, so that the buttons below stay where they are."""
        layout = split(self.layout)
        draw_first(layout, context.scene.patchnet)
        if JobOperator.running:
            layout.progress(factor=JobOperator.fraction, text=f"{JobOperator.running}: Esc stops")
        else:
            row = layout.row()
            row.scale_y = 1.5
            row.operator("patchnet.run_all", icon="PLAY")
        layout.operator("patchnet.estimate", icon="INFO")
        _draw_estimate(layout, context.scene)
        draw_stale(layout, context.scene, "surface", "light")  # of the view beside its button, in Preview


def _draw_estimate(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw the last estimate, and what it was made for."""
    found = results.estimate_of(scene)
    if found is None:
        return
    box = layout.box().column(align=True)
    setting = changed(scene.patchnet, found.settings, *ESTIMATED)
    why = f"'{setting}' changed" if setting else found.stale_because
    if why:
        box.label(text=f"Estimate again: {why}", icon="ERROR")
    for line in found.made_for:
        box.label(text=line)
    for line in found.lines:
        row = box.row()
        row.active = not why
        row.label(text=line)
    if found.too_large:
        box.label(text="Does not fit into memory", icon="ERROR")


CLASSES = (PATCHNET_PT_presets, PATCHNET_PT_main)
