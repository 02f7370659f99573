# SPDX-License-Identifier: GPL-3.0-or-later
"""Material copies that bake into an image; the user's materials stay unchanged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy

from ....patchnet_addon.runtime.omissions import Omissions
from ...scene_access.blender_version import start_nodes, tree_in_use
from ...scene_access.temporary import temporary
from .mean_view import needs_mean_view, use_mean_view
from .object_data import needs_redirect, redirect
from .one_sided import keep_sides, needs_cut


@contextmanager
def bake_materials(
    names: Sequence[str],
    image: bpy.types.Image,
    back: bool,
    through: bool = False,
    *,
    oblique: bool = False,
    gloss: bool = False,
    unread: Omissions | None = None,
) -> Iterator[list[bpy.types.Material]]:
    """Copy each named material, "" for the default one, with `image` as the active node, within the block.

    The copies read attributes instead of the object. back: the mesh shows back sides. through: they show only
    translucent light, else all but that. oblique: what depends on the view is the mean of all views, but not, with
    `gloss`, what reflects. unread: gets the names of materials that cannot be adapted.
    """
    library = {material.name_full: material for material in bpy.data.materials}
    copies: list[bpy.types.Material] = []
    with ExitStack() as stack:

        def changes(tree: bpy.types.NodeTree) -> bool:
            return needs_redirect(tree) or (oblique and needs_mean_view(tree, gloss)) or needs_cut(tree, through)

        def adapt(tree: bpy.types.NodeTree, material_index: int, known: dict[str, bpy.types.NodeTree]) -> None:
            redirect(tree, material_index, back)
            if oblique:
                use_mean_view(tree, gloss)
            keep_sides(tree, through)
            for node in tree.nodes:
                if node.type == "GROUP" and node.node_tree and changes(node.node_tree):
                    group = node.node_tree.name_full
                    if group not in known:
                        known[group] = stack.enter_context(temporary(node.node_tree.copy()))
                        adapt(known[group], material_index, known)
                    node.node_tree = known[group]

        for name in names:
            original = library[name] if name else None
            new = original.copy() if original else bpy.data.materials.new("PatchNet Default")
            copies.append(stack.enter_context(temporary(new)))
            with (unread or Omissions()).leaving_out(name):
                tree = tree_in_use(new)
                if original and tree is not None and changes(tree):
                    adapt(tree, original.pass_index, {})
            aim(new, image, plain=original is None)
        yield copies


def aim(material: bpy.types.Material, image: bpy.types.Image, plain: bool) -> None:
    """Make an image node of `image` the active node; `plain` or without nodes: diffuse, of the viewport colour."""
    if plain or tree_in_use(material) is None:
        tree = start_nodes(material)
        tree.nodes.clear()
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = (*material.diffuse_color[:3], 1.0)
        tree.links.new(diffuse.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    nodes = material.node_tree.nodes
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    for node in nodes:
        node.select = node == target
    nodes.active = target
