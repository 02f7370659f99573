# SPDX-License-Identifier: GPL-3.0-or-later
"""Translucent light, which shines through a surface from behind (shader Translucent).

What is baked lies above the surface, which would keep this light off. So it is baked apart, from below the surface.
"""

from __future__ import annotations

import bpy

from ...scene.layer_names import all_nodes
from ...scene_access.blender_version import tree_in_use

_TRANSLUCENT = "BSDF_TRANSLUCENT"


def is_translucent(material: bpy.types.Material) -> bool:
    """Return whether light shines through a material diffusely."""
    tree = tree_in_use(material)
    return tree is not None and any(node.type == _TRANSLUCENT for node in all_nodes(tree))


def keep_sides(tree: bpy.types.NodeTree, through: bool) -> None:
    """Cut off Translucent shaders of a tree, or, if `through`, all others; groups in it are left to the caller."""
    for node in tree.nodes:
        if _is_surface(node) and (node.type == _TRANSLUCENT) != through:
            for socket in node.outputs:
                for link in list(socket.links):
                    tree.links.remove(link)


def _is_surface(node: bpy.types.Node) -> bool:
    """Return whether a node is a shader of its own, neither a mix of shaders nor a group."""
    return node.type.startswith(("BSDF_", "EMISSION", "SUBSURFACE_SCATTERING", "HOLDOUT", "BACKGROUND"))
