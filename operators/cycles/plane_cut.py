# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut of a scene at a plane, by materials that are transparent beyond it: for the camera alone, or for all rays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy

from ...patchnet_addon.runtime.errors import SceneError
from ..scene_access.blender_version import tree_in_use
from ..scene_access.overrides import changed, put_back_when_saved
from ..scene_access.temporary import temporary

_MOST_LAYERS = 1024  # transparent ones that a ray passes, as Cycles' panel offers


@contextmanager
def replaced_materials(
    scene: bpy.types.Scene, names: Sequence[str], change: Callable[[bpy.types.Material, str], None]
) -> Iterator[None]:
    """Use changed copies of materials, by full name, within the block; all is as before after it.

    change: is called with a copy and the material's name. Rays pass as many transparent layers as Cycles lets them.
    """
    library = {material.name_full: material for material in bpy.data.materials}
    with ExitStack() as stack:
        stack.enter_context(changed(scene.cycles, transparent_max_bounces=_MOST_LAYERS))
        for name in names:
            stack.enter_context(_replaced(library[name], change))
        yield


@contextmanager
def _replaced(material: bpy.types.Material, change: Callable[[bpy.types.Material, str], None]) -> Iterator[None]:
    """Put a changed copy in the place of a material, wherever it is used."""
    with temporary(material.copy(), material) as copy:
        change(copy, material.name)

        def use() -> None:
            material.user_remap(copy)

        def put_back() -> None:
            copy.user_remap(material)

        use()
        try:
            with put_back_when_saved(put_back, use):
                yield
        finally:
            put_back()


Plane = tuple[int, float]  # axis, and coordinate in world units beyond which nothing is


@contextmanager
def cut_for_camera(scene: bpy.types.Scene, names: Sequence[str], plane: Plane) -> Iterator[None]:
    """Let the camera see through what lies beyond a plane, which light meets as before, within the block.

    names: full names of the materials of all surfaces. All is as before after it. Raises SceneError for a surface
    without material, or a material without nodes.
    """
    if "" in names:
        raise SceneError("A surface has no material, and materials are what cuts it open: give it a material")

    def change(copy: bpy.types.Material, name: str) -> None:
        tree = tree_in_use(copy)
        if tree is None:
            raise SceneError(f"Material '{name}' has no nodes, and it is cut open by some: turn on its nodes")
        cut(tree, *plane, camera_only=True)

    with replaced_materials(scene, names, change):
        yield


def cut(tree: bpy.types.NodeTree, axis: int, beyond_world: float, *, camera_only: bool) -> None:
    """Make the surface of a material's nodes transparent beyond a plane across an axis, for all rays or the camera's.

    A camera's ray that has passed such a surface is still the camera's.
    """
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None or not output.inputs["Surface"].is_linked:
        return  # shows nothing anyway
    geometry, parts = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(geometry.outputs["Position"], parts.inputs[0])
    shown = tree.nodes.new("ShaderNodeMath")
    shown.operation = "LESS_THAN"
    tree.links.new(parts.outputs[axis], shown.inputs[0])
    shown.inputs[1].default_value = beyond_world
    if camera_only:
        within, path, shown = shown, tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMath")
        shown.operation = "GREATER_THAN"  # within - is_camera_ray > -1/2
        less = tree.nodes.new("ShaderNodeMath")
        less.operation = "SUBTRACT"
        tree.links.new(within.outputs[0], less.inputs[0])
        tree.links.new(path.outputs["Is Camera Ray"], less.inputs[1])
        tree.links.new(less.outputs[0], shown.inputs[0])
        shown.inputs[1].default_value = -0.5
    mix = mixed_with_transparent(tree, output.inputs["Surface"].links[0].from_socket)
    tree.links.new(shown.outputs[0], mix.inputs[0])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])


def mixed_with_transparent(tree: bpy.types.NodeTree, shown: bpy.types.NodeSocket) -> bpy.types.Node:
    """Mix node whose factor is the share of `shown`."""
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(shown, mix.inputs[2])
    return mix
