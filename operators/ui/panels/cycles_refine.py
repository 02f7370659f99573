# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of the refinement by Cycles: the worst regions."""

from __future__ import annotations

import bpy

from .tab import SubPanel, split


class PATCHNET_PT_cycles_refine(SubPanel, bpy.types.Panel):
    """Refinement with Cycles: how much it renders over the preview, and how well."""

    bl_label = "Refine with Cycles"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, then the button."""
        layout = split(self.layout)
        for name in ("budget", "samples", "light", "tile", "regions", "compare"):
            layout.prop(context.scene.patchnet, f"cycles_{name}")
        layout.operator("patchnet.refine_with_cycles", icon="RENDER_STILL")


CLASSES = (PATCHNET_PT_cycles_refine,)
