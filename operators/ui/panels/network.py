# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of the network: weights and encoder."""

from __future__ import annotations

import bpy

from ...session import results
from ...settings.step_settings import changed
from .tab import SubPanel, draw_sentence, draw_settings, split


class PATCHNET_PT_network(SubPanel, bpy.types.Panel):
    """The network that looks ahead."""

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
        before = result.made_with.get("codes")
        name = changed(context.scene.patchnet, before, "codes") if before is not None else ""
        if name:
            draw_sentence(layout, context, f"'{name}' changed: prepare again", "ERROR")


CLASSES = (PATCHNET_PT_network,)
