# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that tests whether the Python of the preferences has torch."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.errors import SettingError
from .jobs.tell import tell
from .properties import absolute_path
from .properties.preferences import kept, preferences


class PATCHNET_OT_check_python(bpy.types.Operator):
    """Run the Python above, and report its version of torch"""

    bl_idname = "patchnet.check_python"
    bl_label = "Check Python"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require a Python in the preferences."""
        if not preferences(context).torch_python:
            cls.poll_message_set("No Python is chosen: without one, Blender's own prepares look-ahead")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the Python, and keep the answer for the preferences."""
        from ..patchnet_addon.network.other_python import ask_python

        try:
            path = absolute_path(preferences(context).torch_python)
            assert path is not None
            kept.python = ask_python(path)
        except SettingError as error:
            kept.python = str(error)
            tell(self, "ERROR", str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, kept.python)
        return {"FINISHED"}
