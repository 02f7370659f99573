# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of statistics: size, time and errors of the result."""

from __future__ import annotations

import bpy

from ...session import results
from ...session.memory import held
from .tab import SubPanel, draw_sentence, split


class PATCHNET_PT_statistics(SubPanel, bpy.types.Panel):
    """Size, time and errors of the result."""

    bl_label = "Statistics"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Lines that were written when a step ended, what all of it takes, and the button that frees the memory."""
        layout = split(self.layout)
        result = results.result_of(context.scene)
        if result is None:
            draw_sentence(layout, context, "Nothing computed yet")
            return
        column = layout.column(align=True)
        for line in result.summary:
            draw_sentence(column, context, line)
        column = layout.column(align=True)
        taken = held()
        draw_sentence(column, context, f"In memory: {_size(taken.results)}, pictures {_size(taken.images)}")
        if taken.process is not None:
            draw_sentence(column, context, f"Blender as a whole: {_size(taken.process)}")
        layout.operator("patchnet.clear_results", icon="TRASH")


def _size(nbytes: int) -> str:
    return f"{nbytes / 2**20:.1f} MiB" if nbytes < 2**30 else f"{nbytes / 2**30:.2f} GiB"


CLASSES = (PATCHNET_PT_statistics,)
