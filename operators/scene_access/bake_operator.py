# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake operator that lasts as long as its job, whatever scene the window shows.

Blender's bake operator ends at the next event unless the window shows the baked scene, and frees the reports that the
job's thread writes to. As the first step of a macro it lives until the second step ends, which waits for the job. The
macro also hides the report at the end of each page, which asks users to save an image that is not theirs.
"""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from .window_job import BAKE, job_is_running


class PATCHNET_OT_await_bake(bpy.types.Operator):
    """Wait until the bake has ended"""

    bl_idname = "patchnet.await_bake"
    bl_label = "Await Bake"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Begin to wait."""
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, _context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Pass all events through."""
        return {"PASS_THROUGH"} if job_is_running(BAKE) else {"FINISHED", "PASS_THROUGH"}


class PATCHNET_OT_bake_beside_window(bpy.types.Macro):
    """Bake a copy of the scene beside the window"""

    bl_idname = "patchnet.bake_beside_window"
    bl_label = "Bake Beside Window"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}


def start_bake(arguments: dict[str, Any]) -> set[str]:
    """Start Blender's bake with these arguments, in the context's scene."""
    result: set[str] = bpy.ops.patchnet.bake_beside_window("INVOKE_DEFAULT", OBJECT_OT_bake=arguments)
    return result


CLASSES = (PATCHNET_OT_await_bake, PATCHNET_OT_bake_beside_window)


def register() -> None:
    """Register both operators, and the steps of the macro."""
    for item in CLASSES:
        bpy.utils.register_class(item)
    for name in ("OBJECT_OT_bake", "PATCHNET_OT_await_bake"):
        PATCHNET_OT_bake_beside_window.define(name)


def unregister() -> None:
    """Unregister both operators."""
    for item in reversed(CLASSES):
        bpy.utils.unregister_class(item)
