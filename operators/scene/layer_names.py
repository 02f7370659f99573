# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of the UV maps and colour attributes that a material asks for."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

_NAME_PROPERTY = {
    "UVMAP": "uv_map",
    "NORMAL_MAP": "uv_map",
    "TANGENT": "uv_map",
    "VERTEX_COLOR": "layer_name",
    "ATTRIBUTE": "attribute_name",
}


def layer_names(material: bpy.types.Material) -> frozenset[str]:
    """Names that any node of the material mentions, in its groups too, if it says any at all."""
    tree = shader_tree(material)
    if tree is None:
        return frozenset()
    named = (node for node in all_nodes(tree) if node.type in _NAME_PROPERTY)
    return frozenset(name for node in named if (name := getattr(node, _NAME_PROPERTY[node.type])))


def shader_tree(material: bpy.types.Material) -> bpy.types.NodeTree | None:
    """The material's nodes, or None if it uses none (from Blender 5.0 on all materials do)."""
    if bpy.app.version < (5, 0, 0) and not material.use_nodes:
        return None
    return material.node_tree


def all_nodes(tree: bpy.types.NodeTree) -> Iterator[bpy.types.Node]:
    """Nodes of a tree and of the groups in it, each group once."""
    seen, stack = set(), [tree]
    while stack:
        tree = stack.pop()
        if tree.as_pointer() in seen:
            continue
        seen.add(tree.as_pointer())
        for node in tree.nodes:
            yield node
            if node.type == "GROUP" and node.node_tree:
                stack.append(node.node_tree)
