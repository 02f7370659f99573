# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds that are one colour, which need no Cycles to be seen."""

from __future__ import annotations

import bpy
import numpy as np

from ....patchnet_addon.image.background import BLACK
from ...scene_access.blender_version import tree_in_use


def world_color(world: bpy.types.World | None) -> np.ndarray | None:
    """Scene-linear colour (3,) float32 that cameras see of an evaluated world; None if it is not one colour."""
    if world is None or not getattr(getattr(world, "cycles_visibility", None), "camera", True):
        return BLACK
    tree = tree_in_use(world)
    if tree is None:
        return np.array(world.color, np.float32)
    output = tree.get_output_node("CYCLES")
    surface = output.inputs["Surface"] if output else None
    if surface is None or not surface.is_linked:
        return BLACK
    node = surface.links[0].from_node
    if node.mute or surface.links[0].is_muted:
        return None
    if node.type != "BACKGROUND" or any(node.inputs[name].is_linked for name in ("Color", "Strength")):
        return None
    color = np.array(node.inputs["Color"].default_value[:3], np.float32)
    return color * np.float32(node.inputs["Strength"].default_value)
