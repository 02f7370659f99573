# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh layers that nodes of a material read: UV maps, attributes, generated coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene_access.blender_version import tree_in_use

# Layer of generated coordinates, which depend on the texture space of a mesh.
GENERATED = "patchnet_generated"
# Layer of a mesh's default colour attribute, which a Color Attribute node without a name reads.
DEFAULT_COLOR = "patchnet_default_color"
# Textures that use generated coordinates without a link.
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
    """Names in the material's nodes and groups, and GENERATED if a node needs it."""
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
    """Return whether a node yields or takes generated coordinates."""
    if node.type == "TEX_COORD":
        return node.outputs["Generated"].is_linked and not node.from_instancer
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
