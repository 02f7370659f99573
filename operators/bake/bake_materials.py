# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of materials that write their bake into an image; the user's materials are never touched."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy


@contextmanager
def bake_materials(names: Sequence[str], image: bpy.types.Image) -> Iterator[list[bpy.types.Material]]:
    """A copy of each named material, in this order, whose active node is `image`; removed after the block."""
    library = {material.name_full: material for material in bpy.data.materials}
    copies: list[bpy.types.Material] = []
    try:
        for name in names:
            copies.append(library[name].copy() if name else bpy.data.materials.new("PatchNet Default"))
            _aim(copies[-1], image)
        yield copies
    finally:
        for copy in copies:
            bpy.data.materials.remove(copy)


def _aim(material: bpy.types.Material, image: bpy.types.Image) -> None:
    """Make an image node of `image` the active node."""
    if not material.use_nodes:
        material.use_nodes = True
        principled = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
        principled.inputs["Base Color"].default_value = (*material.diffuse_color[:3], 1.0)
    nodes = material.node_tree.nodes
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    for node in nodes:
        node.select = node == target
    nodes.active = target
