# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that copies diagnostics to the clipboard for bug reports: versions, settings, last errors."""

from __future__ import annotations

import json
import logging
from collections import deque
from pathlib import Path
from typing import Any

import bpy

from ..patchnet_addon.process.computed import refused
from ..patchnet_addon.process.own_wheels import other_versions_text
from ..patchnet_addon.runtime.log import LOG
from .properties.preferences import preferences
from .scene_access.devices import gpu_is_enabled
from .scene_access.window_state import Part
from .session import results

_MAX = 20


class _Last(logging.Handler):
    """Log handler that keeps the last warnings and errors."""

    collects = True  # and prints nothing: see `log.set_up`

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: deque[str] = deque(maxlen=_MAX)

    def emit(self, record: logging.LogRecord) -> None:
        trace = getattr(record, "fields", {}).get("traceback", "")
        self.said.append(f"{record.levelname}: {record.getMessage()}" + (f"\n{trace}" if trace else ""))


_last = Part("last_messages", _Last)


class PATCHNET_OT_copy_diagnostics(bpy.types.Operator):
    """Copy versions, machine, settings and the last errors to the clipboard, to paste them into a request for help"""

    bl_idname = "patchnet.copy_diagnostics"
    bl_label = "Copy Diagnostics"
    bl_options = {"REGISTER"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy the text."""
        context.window_manager.clipboard = diagnostics(context)
        self.report({"INFO"}, "Diagnostics are on the clipboard")
        return {"FINISHED"}


def diagnostics(context: bpy.types.Context) -> str:
    """Text of the diagnostics; the user's home folder is written as ~."""
    from .pipeline.reports import machine, versions  # slow: imports much of the library

    result = results.result_of(context.scene)
    values = {
        "versions": versions(),
        "engine": refused() or other_versions_text(computes_with_own=True),
        "machine": machine() | {"gpu_for_cycles": gpu_is_enabled(context)},
        "preferences": vars(preferences(context)),
        "settings": _settings(context.scene.patchnet),
        "result": result.summary if result else None,
        "stale": {name: result.why(name) for name in sorted(result.stale)} if result else None,
        "last warnings and errors": list(_last().said),
    }
    return json.dumps(values, indent=1, default=str).replace(str(Path.home()), "~")


def _settings(values: bpy.types.PropertyGroup) -> dict[str, Any]:
    found = {}
    for item in values.bl_rna.properties:
        if item.identifier not in ("rna_type", "name"):
            value = getattr(values, item.identifier)
            found[item.identifier] = list(value) if getattr(item, "is_array", False) else value
    return found


def register() -> None:
    """Add the handler to the log."""
    LOG.addHandler(_last())


def unregister() -> None:
    """Remove the handler from the log."""
    LOG.removeHandler(_last())
