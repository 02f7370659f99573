# SPDX-License-Identifier: GPL-3.0-or-later
"""What is there, in figures."""

from __future__ import annotations

import bpy

from .. import results
from .tab import SubPanel, split


class PATCHNET_PT_statistics(SubPanel, bpy.types.Panel):
    """Size, time and errors of the result."""

    bl_label = "Statistics"

    def draw(self, context: bpy.types.Context) -> None:
        """Lines that were written when a step ended, and the button that frees the memory."""
        layout = split(self.layout)
        result = results.result_of(context.scene)
        if result is None:
            layout.label(text="Nothing computed yet")
            return
        column = layout.column(align=True)
        for line in result.summary:
            column.label(text=line)
        layout.operator("patchnet.clear_results", icon="TRASH")


CLASSES = (PATCHNET_PT_statistics,)
