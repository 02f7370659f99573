# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that matter to each step with their present values, and the changed ones since a step was done."""

from __future__ import annotations

from typing import Any

import bpy

from ..importance import IMAGE, VERTEX_GROUP
from .job_settings import CYCLES

ESTIMATED = ("octree", "light", "cameras")  # what an estimate depends on
_RESOLUTION = {"DEPTH": ("depth",), "VOXEL_SIZE": ("voxel_size",), "FIT": ("track",)}


def step_settings(values: bpy.types.PropertyGroup, step: str) -> tuple[str, ...]:
    """Names of the settings of a step that count now, as the panel shows them.

    step: "octree", "light", "codes", "view", or "cameras" and "importance", which are parts of the view's.
    """
    if step == "octree":
        return ("scope", "resolution", *_RESOLUTION.get(values.resolution, ()), "memory")
    if step == "light":
        baked = ("samples", "texel_voxels", "both_sides", "device") if values.light == CYCLES else ()
        return ("light", *baked, "exposure", "color")
    if step == "codes":
        return ("weights", "encoder_device")
    if step == "cameras":
        return ("cameras", "size")
    painted = {IMAGE: ("importance_image",), VERTEX_GROUP: ("importance_group",)}.get(values.importance, ())
    if step == "importance":
        return ("importance", *painted)
    return ("cameras", "size", "strategy", "budget", "heatmap_maximum", "importance", *painted)


# What decides which device computes, and bounds that need not bite, change no result.
_NO_RESULT = frozenset({"memory", "device", "encoder_device", "heatmap_maximum"})


def recorded(values: bpy.types.PropertyGroup, *steps: str) -> dict[str, Any]:
    """Record the values of the steps' settings, to compare with later ones."""
    found = {}
    for step in steps:
        for name in step_settings(values, step):
            if name not in _NO_RESULT:
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
