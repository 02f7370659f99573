# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that matter to each step with their present values, and the changed ones since a step was done."""

from __future__ import annotations

from typing import Any

import bpy

from ..schema.setting import Effect
from ..schema.table import CAMERAS, IMPORTANCE, LIGHT, OCTREE, TABLE, VIEW, rows

ESTIMATED = (OCTREE, LIGHT, CAMERAS)  # what an estimate depends on
_PARTS = {VIEW: (CAMERAS, VIEW, IMPORTANCE)}  # of a step that several stages feed


def step_settings(values: bpy.types.PropertyGroup, step: str) -> tuple[str, ...]:
    """Names of the settings of a step that count now, as the panel shows them.

    step: "octree", "light", "codes", "view", or "cameras" and "importance", which are parts of the view's.
    """
    return tuple(row.name for row in rows(*_PARTS.get(step, (step,))) if row.counts(values))


def recorded(values: bpy.types.PropertyGroup, *steps: str) -> dict[str, Any]:
    """Record the values of the steps' settings, to compare with later ones."""
    found = {}
    for step in steps:
        for name in step_settings(values, step):
            if TABLE[name].effect is Effect.ALWAYS:
                value = getattr(values, name)
                found[name] = tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
    return found


def changed(values: bpy.types.PropertyGroup, before: dict[str, Any], *steps: str) -> str:
    """Name of a setting of the steps that is not as it was, as the panel shows it; "" if all are."""
    now = recorded(values, *steps)
    for name in now:
        if name not in before or before[name] != now[name]:
            return str(values.bl_rna.properties[name].name)
    return ""
