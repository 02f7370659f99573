# SPDX-License-Identifier: GPL-3.0-or-later
"""Differences between the Blender versions that are supported: 4.5, 5.2 and 5.3. No other module asks for the version.

Differences of the API are tested in place with `hasattr`, and need no name here.
"""

from __future__ import annotations

import bpy

# Materials, worlds and lamps may have no nodes; from 5.0 on all have nodes, and reading `use_nodes` warns.
NODES_ARE_OPTIONAL = bpy.app.version < (5, 0, 0)
# Cycles draws polylines of hair straight, not as curves through their points.
POLYLINES_ARE_STRAIGHT = bpy.app.version >= (5, 0, 0)
# Cycles takes the pixels of an image for what its alpha mode says; before, for straight if they are bytes.
ALPHA_MODES_ARE_OF_PIXELS = bpy.app.version >= (5, 0, 0)
# Attributes of a mesh cannot have names of Cycles' own, such as "color": there they count as missing.
CYCLES_NAMES_ARE_RESERVED = bpy.app.version < (5, 0, 0)


def tree_in_use(block: bpy.types.Material | bpy.types.World | bpy.types.Light) -> bpy.types.NodeTree | None:
    """Nodes that decide what a material, world or lamp shows; None if it has none."""
    return None if NODES_ARE_OPTIONAL and not block.use_nodes else block.node_tree


def start_nodes(block: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """Switch on the nodes of a material or world, and return them."""
    if tree_in_use(block) is None:
        block.use_nodes = True
    return block.node_tree
