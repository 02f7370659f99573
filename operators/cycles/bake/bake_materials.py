# SPDX-License-Identifier: GPL-3.0-or-later
"""Material copies that write their bake into an image; the user's materials are never touched."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy

from ...scene_access.blender_version import start_nodes, tree_in_use
from ...scene_access.temporary import temporary
from .object_data import needs_redirect, redirect
from .one_sided import is_translucent, keep_sides


@contextmanager
def bake_materials(
    names: Sequence[str], image: bpy.types.Image, back: bool, through: bool = False, *, oblique: bool = False
) -> Iterator[list[bpy.types.Material]]:
    """Copy each named material, in this order, with `image` as the active node; removed after the block.

    The copies take from attributes what they would ask the object. back: the mesh shows back sides. through: they show
    only what shines through from behind, else all but that. oblique: what depends on the angle of view is as for the
    mean of all views.
    """
    with ExitStack() as stack:
        copies = _Copies(through, oblique, stack)
        for name in names:
            copies.add(name, image, back)
        yield copies.materials


class _Copies:
    """Copies of materials and of the node groups in them, until `stack` is closed."""

    def __init__(self, through: bool, oblique: bool, stack: ExitStack) -> None:
        self._through, self._oblique, self._stack = through, oblique, stack
        self.materials: list[bpy.types.Material] = []
        self._library = {material.name_full: material for material in bpy.data.materials}

    def add(self, name: str, image: bpy.types.Image, back: bool) -> None:
        """Copy a material by its full name; "" is what Cycles shows without one."""
        original = self._library[name] if name else None
        new = original.copy() if original else bpy.data.materials.new("PatchNet Default")
        copy = self._stack.enter_context(temporary(new))
        self.materials.append(copy)
        if original and (needs_redirect(original) or is_translucent(original)):
            self._redirect(copy.node_tree, original.pass_index, back, {})
        _aim(copy, image, plain=original is None)

    def _redirect(
        self, tree: bpy.types.NodeTree, material_index: int, back: bool, known: dict[str, bpy.types.NodeTree]
    ) -> None:
        redirect(tree, material_index, back, self._oblique)
        keep_sides(tree, self._through)
        for node in tree.nodes:
            if node.type == "GROUP" and node.node_tree:
                name = node.node_tree.name_full
                if name not in known:
                    known[name] = self._stack.enter_context(temporary(node.node_tree.copy()))
                    self._redirect(known[name], material_index, back, known)
                node.node_tree = known[name]


def _aim(material: bpy.types.Material, image: bpy.types.Image, plain: bool) -> None:
    """Make an image node of `image` the active node; `plain`: diffuse, as Cycles shows a surface without material."""
    if plain or tree_in_use(material) is None:
        _make_diffuse(material)
    nodes = material.node_tree.nodes
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    for node in nodes:
        node.select = node == target
    nodes.active = target


def _make_diffuse(material: bpy.types.Material) -> None:
    """Nodes that show the viewport colour."""
    tree = start_nodes(material)
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*material.diffuse_color[:3], 1.0)
    tree.links.new(diffuse.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
