# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh layers that nodes of a material read: UV maps, attributes, generated coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene_access.blender_version import CYCLES_NAMES_ARE_RESERVED, tree_in_use
from ..state.digest import composed, names

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


def own_name(*parts: str) -> str:
    """Name of a layer of ours, hashed: no layer of the user's is equal, and Blender 4.5 truncates long names."""
    return f"patchnet {composed(*parts)}"


# Layer of generated coordinates, which depend on the texture space of a mesh.
GENERATED = own_name("generated")
# Layer of a mesh's default colour attribute, which a Color Attribute node without a name reads.
DEFAULT_COLOR = own_name("default color")

# Names that Cycles does not look up in the mesh: it computes their values, or has none.
_STANDARD = {"generated": GENERATED} | dict.fromkeys(names("N uv tangent pointiness random_per_island"), "")
if CYCLES_NAMES_ARE_RESERVED:
    _STANDARD |= {"vertex_color": DEFAULT_COLOR} | dict.fromkeys(
        names(
            """tangent_sign generated_transform undeformed undisplaced motion_P motion_N particle density color
            flame heat temperature velocity velocity_x velocity_y velocity_z curve_intercept curve_length
            curve_random point_random ptex_face_id ptex_uv shadow_transparency"""
        ),
        "",
    )


def layer_names(material: bpy.types.Material) -> frozenset[str]:
    """Names in the material's nodes and groups, and GENERATED if a node needs it."""
    tree = tree_in_use(material)
    if tree is None:
        return frozenset()
    nodes = list(all_nodes(tree))
    generated = {GENERATED} if any(map(needs_generated, nodes)) else set()
    return frozenset(({layer_of(node) for node in nodes} | generated) - {""})


def layer_of(node: bpy.types.Node) -> str:
    """Layer that a node reads by its name, DEFAULT_COLOR without a name, or GENERATED; "" if it reads none."""
    if node.type not in _NAME_PROPERTY or (node.type == "ATTRIBUTE" and node.attribute_type != "GEOMETRY"):
        return ""
    name: str = getattr(node, _NAME_PROPERTY[node.type])
    if node.type == "VERTEX_COLOR":
        return DEFAULT_COLOR if not name else "" if name in _STANDARD else name
    return _STANDARD.get(name, name) if node.type == "ATTRIBUTE" else name


def name_layer(node: bpy.types.Node, name: str) -> None:
    """Make a node with a layer read the layer `name`."""
    setattr(node, _NAME_PROPERTY[node.type], name)


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
