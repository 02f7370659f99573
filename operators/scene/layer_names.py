# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh layers that the nodes of a material read: UV maps and attributes by name, generated coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene_access.blender_version import tree_in_use

# The layer that holds generated coordinates, which belong to a mesh and its texture space.
GENERATED = "patchnet_generated"
# The layer that holds a mesh's default colour attribute, which a Color Attribute node without a name reads.
DEFAULT_COLOR = "patchnet_default_color"
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
        if needs_generated(node):
            names.add(GENERATED)
        elif asks_default_color(node):
            names.add(DEFAULT_COLOR)
    return frozenset(names - {""})


def asks_default_color(node: bpy.types.Node) -> bool:
    """Return whether a node reads the mesh's default colour attribute."""
    return node.type == "VERTEX_COLOR" and not node.layer_name


def needs_generated(node: bpy.types.Node) -> bool:
    """Return whether a node yields or takes generated coordinates, or a tangent that is made of them."""
    if node.type == "TEX_COORD":
        return node.outputs["Generated"].is_linked and not node.from_instancer
    if asks_tangent(node):
        return True
    return node.type in GENERATED_BY_DEFAULT and not node.inputs["Vector"].is_linked


def asks_tangent(node: bpy.types.Node) -> bool:
    """Return whether a node yields a tangent around an axis of the generated coordinates."""
    if node.type == "NEW_GEOMETRY":
        return node.outputs["Tangent"].is_linked
    return node.type == "TANGENT" and node.direction_type == "RADIAL"


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
