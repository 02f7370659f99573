# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of materials that write their bake into an image; the user's materials are never touched."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..scene.layer_names import shader_tree


@contextmanager
def bake_materials(names: Sequence[str], image: bpy.types.Image) -> Iterator[list[bpy.types.Material]]:
    """A copy of each named material, in this order, whose active node is `image`; removed after the block."""
    library = {material.name_full: material for material in bpy.data.materials}
    copies: list[bpy.types.Material] = []
    try:
        for name in names:
            copies.append(library[name].copy() if name else bpy.data.materials.new("PatchNet Default"))
            _aim(copies[-1], image, plain=not name)
        yield copies
    finally:
        for copy in copies:
            bpy.data.materials.remove(copy)


def _aim(material: bpy.types.Material, image: bpy.types.Image, plain: bool) -> None:
    """Make an image node of `image` the active node. `plain`: diffuse, as Cycles shows a surface without material."""
    if plain or shader_tree(material) is None:
        _make_diffuse(material)
    nodes = material.node_tree.nodes
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    for node in nodes:
        node.select = node == target
    nodes.active = target


def _make_diffuse(material: bpy.types.Material) -> None:
    """Nodes that show the viewport colour."""
    if shader_tree(material) is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*material.diffuse_color[:3], 1.0)
    tree.links.new(diffuse.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
