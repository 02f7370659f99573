# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages of operators: as Blender's report, and as an event of the log."""

from __future__ import annotations

import logging
from typing import Any

import bpy

from ...patchnet_addon.runtime import log

_EVENTS = {
    "INFO": ("result", logging.INFO),
    "WARNING": ("warning", logging.WARNING),
    "ERROR": ("error", logging.ERROR),
}


def tell(operator: bpy.types.Operator, kind: str, text: str, *, logged_as: str = "", **fields: Any) -> None:
    """Report INFO (what was done), WARNING or ERROR.

    logged_as: the kind that the log takes it for, if another. fields: of the event.
    """
    operator.report({kind}, text)
    name, level = _EVENTS[logged_as or kind]
    log.event(name, text, level, **fields)


def tell_start(operator: bpy.types.Operator) -> None:
    """Say in the log that an operator begins, and on which file."""
    log.start(operator.bl_label, file=bpy.data.filepath or None)
