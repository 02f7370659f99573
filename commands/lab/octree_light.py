# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene for Cycles as its octree shows it: the same surface and light, cut open at the same plane.

Two Lights, the paper's light without shadows, is rendered by emissive materials (methods 7.3). Cycles' lamps do not
match it: they shade by smooth normals, and light no diffuse base color of metals. So a surface emits the light that an
octree stores for Two Lights: base color times |normal . direction|, plus its emission. Beyond the cut plane materials
are transparent, for camera rays or for all rays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from ...operators.scene.read import read_scene
from ...operators.scene_access.blender_version import tree_in_use
from ...operators.scene_access.overrides import changed, put_back_when_saved
from ...operators.scene_access.temporary import temporary
from ...operators.schema.table import TWO_LIGHTS
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import SceneError

_BASE = {"BSDF_PRINCIPLED": "Base Color", "BSDF_DIFFUSE": "Color"}
_KEPT = frozenset({"MIX_SHADER", "ADD_SHADER", "BSDF_TRANSPARENT", "EMISSION"})
_MOST_LAYERS = 1024  # transparent layers per ray, the maximum of Cycles' panel

Plane = tuple[int, float]  # axis, and coordinate of the cut in world units


@contextmanager
def two_lights(
    scene: bpy.types.Scene, names: Sequence[str], direction: Sequence[float], plane: Plane | None = None
) -> Iterator[None]:
    """Replace materials, by full name, by emission of the light of two antipodal lights within the block.

    plane: beyond it they are transparent. Raises SceneError for a surface without material, or for shaders other than
    principled, diffuse, transparent and emission.
    """
    if "" in names:
        raise SceneError("A surface has no material, which Two Lights need: assign a material to it")
    toward = np.asarray(direction, np.float64)
    toward /= np.linalg.norm(toward)

    def change(copy: bpy.types.Material, name: str) -> None:
        _make_shine(copy, name, toward, plane)

    with replaced_materials(scene, names, change):
        yield


def _make_shine(copy: bpy.types.Material, name: str, direction: np.ndarray, plane: Plane | None) -> None:
    tree = tree_in_use(copy)
    if tree is None:
        raise SceneError(f"Material '{name}' has no nodes, which Two Lights need: enable its nodes")
    for node in list(tree.nodes):
        if node.type in _BASE:
            shine = _shine(tree, node, direction)
            for link in list(node.outputs[0].links):
                tree.links.new(shine, link.to_socket)
        elif node.type not in _KEPT and any(each.type == "SHADER" and each.is_linked for each in node.outputs):
            raise SceneError(
                f"Material '{name}' has a shader '{node.name}', which Two Lights do not support: use a Principled BSDF"
            )
    if plane is not None:
        cut(tree, *plane, camera_only=False)


def _shine(tree: bpy.types.NodeTree, node: bpy.types.Node, direction: np.ndarray) -> bpy.types.NodeSocket:
    """Shader output that emits a node's base color in Two Lights plus its emission, with the node's transparency."""
    base = tree.nodes.new("ShaderNodeEmission")
    _same(tree, node.inputs[_BASE[node.type]], base.inputs["Color"])
    tree.links.new(_cosine(tree, direction), base.inputs["Strength"])
    if node.type != "BSDF_PRINCIPLED":
        return base.outputs[0]
    own, both = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeAddShader")
    _same(tree, node.inputs["Emission Color"], own.inputs["Color"])
    _same(tree, node.inputs["Emission Strength"], own.inputs["Strength"])
    tree.links.new(base.outputs[0], both.inputs[0])
    tree.links.new(own.outputs[0], both.inputs[1])
    mix = mixed_with_transparent(tree, both.outputs[0])
    _same(tree, node.inputs["Alpha"], mix.inputs[0])
    return mix.outputs[0]


def _cosine(tree: bpy.types.NodeTree, direction: np.ndarray) -> bpy.types.NodeSocket:
    """Output |n . d| of the flat normal."""
    geometry, dot = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeVectorMath")
    dot.operation = "DOT_PRODUCT"
    tree.links.new(geometry.outputs["True Normal"], dot.inputs[0])
    dot.inputs[1].default_value = direction.tolist()
    size = tree.nodes.new("ShaderNodeMath")
    size.operation = "ABSOLUTE"
    tree.links.new(dot.outputs["Value"], size.inputs[0])
    return size.outputs[0]


def _same(tree: bpy.types.NodeTree, source: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
    """Copy an input's link or value to another input."""
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
    else:
        target.default_value = source.default_value


@contextmanager
def as_in_octree(
    context: bpy.types.Context, octree: Octree, light: str, bisect: tuple[int, float] | None = None
) -> Iterator[None]:
    """Light the open scene as an octree of it with the light `light`, within the block.

    Baked light is already the scene's own, and of the whole scene if the octree is cut open: then only the camera sees
    through the parts beyond the plane. bisect: axis and share of that plane. Raises SceneError for an octree of another
    surface or light, and as `two_lights` and `cut_for_camera`.
    """
    from ...patchnet_addon.surface.shading import DIRECTION

    source = read_scene(context.evaluated_depsgraph_get())
    found = octree.provenance.get("light")
    if found != light:
        raise SceneError(f"The octree's light is {found!r}, and the scene's is {light!r}: give an octree in that light")
    wanted, grid = Grid.around(source.bounds_world, octree.grid.depth), octree.grid
    off = np.abs(np.subtract((*wanted.origin_world, wanted.side_world), (*grid.origin_world, grid.side_world)))
    if off.max() > grid.voxel_size_world:
        raise SceneError(
            f"The octree's cube, of side {grid.side_world:g}, is not that around the scene, of side "
            f"{wanted.side_world:g}: give an octree of this scene without the hidden objects"
        )
    plane = None
    if bisect is not None:
        axis, share = bisect
        low, high = source.bounds_world[:, axis]
        plane = axis, float(low + share * (high - low))
    with ExitStack() as stack:
        if light == TWO_LIGHTS:
            stack.enter_context(two_lights(context.scene, source.material_names, DIRECTION, plane))
        elif plane is not None:
            stack.enter_context(cut_for_camera(context.scene, source.material_names, plane))
        yield


@contextmanager
def replaced_materials(
    scene: bpy.types.Scene, names: Sequence[str], change: Callable[[bpy.types.Material, str], None]
) -> Iterator[None]:
    """Replace materials, by full name, by changed copies within the block.

    change: modifies a copy; its second argument is the material's name. Rays pass the maximum number of transparent
    layers.
    """
    library = {material.name_full: material for material in bpy.data.materials}
    with ExitStack() as stack:
        stack.enter_context(changed(scene.cycles, transparent_max_bounces=_MOST_LAYERS))
        for name in names:
            stack.enter_context(_replaced(library[name], change))
        yield


@contextmanager
def _replaced(material: bpy.types.Material, change: Callable[[bpy.types.Material, str], None]) -> Iterator[None]:
    """Replace a material by a changed copy wherever it is used."""
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


@contextmanager
def cut_for_camera(scene: bpy.types.Scene, names: Sequence[str], plane: Plane) -> Iterator[None]:
    """Make parts beyond a plane invisible to the camera within the block; other rays meet them as before.

    names: full names of all materials. Raises SceneError for a surface without material, or a material without nodes.
    """
    if "" in names:
        raise SceneError("A surface has no material, which the cut needs: assign a material to it")

    def change(copy: bpy.types.Material, name: str) -> None:
        tree = tree_in_use(copy)
        if tree is None:
            raise SceneError(f"Material '{name}' has no nodes, which the cut needs: enable its nodes")
        cut(tree, *plane, camera_only=True)

    with replaced_materials(scene, names, change):
        yield


def cut(tree: bpy.types.NodeTree, axis: int, beyond_world: float, *, camera_only: bool) -> None:
    """Make a material transparent beyond a plane across an axis, for all rays or camera rays only.

    A camera ray behind a transparent surface is still a camera ray.
    """
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None or not output.inputs["Surface"].is_linked:
        return  # invisible anyway
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
