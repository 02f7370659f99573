# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths as text in the units of a scene."""

from __future__ import annotations

import bpy

_NONE = "NONE"


def length_text(scene: bpy.types.Scene, length_world: float) -> str:
    """Length with its unit, such as 11.7 mm or 461 thou; "0.01172 units" where the scene has no unit system."""
    units = scene.unit_settings
    if units.system == _NONE:
        return f"{length_world:.4g} units"
    return bpy.utils.units.to_string(units.system, "LENGTH", length_world * units.scale_length, precision=4).strip()
