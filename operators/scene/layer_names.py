# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh layers that the nodes of a material read: UV maps and attributes by name, generated coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene_access.blender_version import tree_in_use

# The layer that holds generated coordinates, which belong to a mesh and its texture space.
GENERATED = "patchnet_generated"
# Textures that take generated coordinates if nothing else is linked to them.
GENERATED_BY_DEFAULT = frozenset(
    {
        "TEX_NOISE", "TEX_VORONOI", "TEX_WAVE", "TEX_MAGIC", "TEX_GRADIENT", "TEX_CHECKER", "TEX_BRICK", "TEX_GABOR",
        "TEX_MUSGRAVE",
    }
)  # fmt: skip

_NAME_PROPERTY = {
    "UVMAP": "uv_map",
    "NORMAL_MAP": "uv_map",
    "TANGENT": "uv_map",
    "VERTEX_COLOR": "layer_name",
    "ATTRIBUTE": "attribute_name",
}


def layer_names(material: bpy.types.Material) -> frozenset[str]:
    """Names that any node of the material mentions, in its groups too, and GENERATED if one needs it."""
    tree = tree_in_use(material)
    if tree is None:
        return frozenset()
    names = set()
    for node in all_nodes(tree):
        if node.type in _NAME_PROPERTY:
            names.add(getattr(node, _NAME_PROPERTY[node.type]))
        elif needs_generated(node):
            names.add(GENERATED)
    return frozenset(names - {""})


def needs_generated(node: bpy.types.Node) -> bool:
    """Return whether a node yields or takes generated coordinates."""
    if node.type == "TEX_COORD":
        return node.outputs["Generated"].is_linked
    return node.type in GENERATED_BY_DEFAULT and not node.inputs["Vector"].is_linked


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
