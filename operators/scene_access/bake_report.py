# SPDX-License-Identifier: GPL-3.0-or-later
"""Replacement of Blender's report at the end of a bake into an image, "Baking map saved to internal image, ...".

Beside a window that report stands in the status bar for seconds, after each page, and asks users to save what is none
of theirs. It cannot be kept back, but only the last report is shown: ours comes before the bar is drawn again.
"""

from __future__ import annotations

from contextlib import suppress
from typing import ClassVar

import bpy

_TEXT = "A part of the light is baked; there is nothing to save"


class PATCHNET_OT_replace_bake_report(bpy.types.Operator):
    """Report that a part of the light is baked"""

    bl_idname = "patchnet.replace_bake_report"
    bl_label = "Replace Bake Report"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Wait for the next event: what an operator reports in a call of Python's is not for the status bar."""
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, _context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Report, and let the event go on."""
        self.report({"INFO"}, _TEXT)
        return {"FINISHED", "PASS_THROUGH"}


def replace_bake_report() -> None:
    """Show our report in the place of that of a bake that has just ended beside a window."""
    with suppress(AttributeError, RuntimeError):  # the extension is being switched off; no window is there any more
        bpy.ops.patchnet.replace_bake_report("INVOKE_DEFAULT")


CLASSES = (PATCHNET_OT_replace_bake_report,)
