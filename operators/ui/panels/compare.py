# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of the comparison: strategies against each other and against the reference, as numbers."""

from __future__ import annotations

import bpy

from ....patchnet_addon.runtime.quantities import error_text
from ...session import results
from ...session.scene_result import Comparison
from .tab import SubPanel, draw_sentence, draw_setting, draw_stale, split

_NAMES = 0.5  # of the table's width


class PATCHNET_PT_compare(SubPanel, bpy.types.Panel):
    """Strategies compared: the error that each leaves on the chosen view."""

    bl_label = "Compare"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, and the table of the last comparison."""
        layout = split(self.layout)
        layout.operator("patchnet.compare", icon="SORTSIZE")
        draw_setting(layout, context.scene.patchnet, "reference")
        layout.prop(context.scene.patchnet, "strategy")  # all of them
        result = results.result_of(context.scene)
        if result is None or result.comparison is None:
            draw_sentence(layout, context, "Not compared yet", "INFO")
            return
        found = result.comparison
        draw_stale(layout, context, "view")
        draw_sentence(layout, context, f"{found.view}: squared error x 10,000, budget {found.budget:.0%}")
        table = layout.box().column(align=True)
        _row(table, context, "Strategy", "Error", "Left")
        for title, error in found.pictures:
            _row(table, context, f"{title}, unrefined", error_text(error), _share(error, found))
        for row in found.rows:
            marked = "> " if row.name == context.scene.patchnet.strategy else ""
            _row(table, context, f"{marked}{row.title}", error_text(row.error), _share(row.error, found))


def _share(error: float, found: Comparison) -> str:
    return f"{error / found.unrefined:.0%}" if found.unrefined else "-"


def _row(layout: bpy.types.UILayout, context: bpy.types.Context, name: str, error: str, share: str) -> None:
    row = layout.split(factor=_NAMES)
    draw_sentence(row, context, name, share=_NAMES)
    numbers = row.split(factor=0.6)
    numbers.label(text=error)
    numbers.label(text=share)


CLASSES = (PATCHNET_PT_compare,)
