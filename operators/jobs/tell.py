# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages of operators: as Blender's report, and as an event of the log."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any

import bpy

from ...patchnet_addon.runtime import log
from ...patchnet_addon.runtime.quantities import counted

_EVENTS = {
    "INFO": ("result", logging.INFO),
    "WARNING": ("warning", logging.WARNING),
    "ERROR": ("error", logging.ERROR),
}


def tell(operator: bpy.types.Operator, kind: str, text: str, *, logged_as: str = "", **fields: Any) -> None:
    """Report INFO, WARNING or ERROR, and log it.

    logged_as: another kind for the log. fields: of the event.
    """
    operator.report({kind}, text)
    name, level = _EVENTS[logged_as or kind]
    log.event(name, text, level, **fields)


def tell_notes(operator: bpy.types.Operator, notes: Iterable[str], below: str = "Preview Selection") -> str:
    """Report notes as warnings; return the end of a report with their number and place."""
    said = list(dict.fromkeys(notes))
    for text in said:
        tell(operator, "WARNING", text)
    where = "" if bpy.app.background else f" below {below}"
    return f"; {counted(len(said), 'note')}{where}" if said else ""


def tell_start(operator: bpy.types.Operator) -> None:
    """Log that an operator begins, with its file."""
    log.start(operator.bl_label, file=bpy.data.filepath or None)
