# SPDX-License-Identifier: GPL-3.0-or-later
"""World background: the colour that is seen beside all surfaces."""

from __future__ import annotations

import bpy
import numpy as np

VARIES = (
    "The world's background is a texture or a sky, of which PatchNet renders nothing: black is shown behind objects"
)


def world_color(world: bpy.types.World | None) -> np.ndarray | None:
    """Scene-linear colour (3,) float32 of an evaluated world; None if it is not one colour."""
    black = np.zeros(3, np.float32)
    if world is None:
        return black
    if (bpy.app.version < (5, 0, 0) and not world.use_nodes) or world.node_tree is None:
        return np.array(world.color, np.float32)
    output = world.node_tree.get_output_node("CYCLES")
    surface = output.inputs["Surface"] if output else None
    if surface is None or not surface.is_linked:
        return black
    node = surface.links[0].from_node
    if node.type != "BACKGROUND" or any(node.inputs[name].is_linked for name in ("Color", "Strength")):
        return None
    color = np.array(node.inputs["Color"].default_value[:3], np.float32)
    return color * np.float32(node.inputs["Strength"].default_value)
