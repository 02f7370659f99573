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
    if not material.use_nodes or material.node_tree is None:
        return frozenset()
    names = (
        getattr(node, _NAME_PROPERTY[node.type])
        for node in all_nodes(material.node_tree)
        if node.type in _NAME_PROPERTY
    )
    return frozenset(name for name in names if name)


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
