# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene for Cycles as its octree shows it: the same surface and light, cut open at the same plane.

Two Lights, the paper's light without shadows, is rendered by emissive materials (methods 7.3). Cycles' lamps do not
match it: they shade by smooth normals, and light no diffuse base color of metals. So a surface emits the light that an
octree stores for Two Lights: base color times |normal . direction|, plus its emission. Beyond the cut plane materials
are transparent for camera rays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext

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
def as_in_octree(
    context: bpy.types.Context, octree: Octree, light: str, bisect: tuple[int, float] | None = None
) -> Iterator[None]:
    """Light the open scene as an octree of it with the light `light`, within the block.

    Baked light is already the scene's own, and of the whole scene if the octree is cut open: then only the camera sees
    through the parts beyond the plane. bisect: axis and share of that plane. Raises SceneError for an octree of another
    surface or light, and as `shown_as`.
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
    direction = DIRECTION if light == TWO_LIGHTS else None
    is_own = direction is None and plane is None
    with nullcontext() if is_own else shown_as(context.scene, source.material_names, direction, plane):
        yield


@contextmanager
def shown_as(
    scene: bpy.types.Scene, names: Sequence[str], direction: Sequence[float] | None = None, plane: Plane | None = None
) -> Iterator[None]:
    """Replace materials, by full name, by changed copies within the block.

    direction: of two antipodal lights, whose light surfaces then emit. plane: beyond it the camera sees through
    surfaces; other rays meet them as before. Rays pass the maximum number of transparent layers. Raises SceneError for
    a surface without material, a material without nodes, and with two lights for shaders other than principled,
    diffuse, transparent and emission.
    """
    if "" in names:
        raise SceneError("A surface has no material, which the comparison needs: assign a material to it")
    library = {material.name_full: material for material in bpy.data.materials}
    with ExitStack() as stack:
        stack.enter_context(changed(scene.cycles, transparent_max_bounces=_MOST_LAYERS))
        for name in names:
            tree = tree_in_use(stack.enter_context(_replaced(library[name])))
            if tree is None:
                raise SceneError(f"Material '{name}' has no nodes, which the comparison needs: enable its nodes")
            if direction is not None:
                _make_shine(tree, name, np.asarray(direction) / np.linalg.norm(direction))
            if plane is not None:
                _cut(tree, *plane)
        yield


@contextmanager
def _replaced(material: bpy.types.Material) -> Iterator[bpy.types.Material]:
    """Replace a material by a copy wherever it is used."""
    with temporary(material.copy(), material) as copy:

        def use() -> None:
            material.user_remap(copy)

        def put_back() -> None:
            copy.user_remap(material)

        use()
        try:
            with put_back_when_saved(put_back, use):
                yield copy
        finally:
            put_back()


def _make_shine(tree: bpy.types.NodeTree, name: str, direction: np.ndarray) -> None:
    for node in list(tree.nodes):
        if node.type in _BASE:
            shine = _shine(tree, node, direction)
            for link in list(node.outputs[0].links):
                tree.links.new(shine, link.to_socket)
        elif node.type not in _KEPT and any(each.type == "SHADER" and each.is_linked for each in node.outputs):
            raise SceneError(
                f"Material '{name}' has a shader '{node.name}', which Two Lights do not support: use a Principled BSDF"
            )


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
    return _math(tree, "ABSOLUTE", dot.outputs["Value"], 0.0)


def _same(tree: bpy.types.NodeTree, source: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
    """Copy an input's link or value to another input."""
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
    else:
        target.default_value = source.default_value


def _cut(tree: bpy.types.NodeTree, axis: int, beyond_world: float) -> None:
    """Make a material transparent for camera rays beyond a plane; behind it they still are camera rays."""
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None or not output.inputs["Surface"].is_linked:
        return  # invisible anyway
    geometry, parts = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(geometry.outputs["Position"], parts.inputs[0])
    within = _math(tree, "LESS_THAN", parts.outputs[axis], beyond_world)
    less = _math(tree, "SUBTRACT", within, tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"])
    shown = _math(tree, "GREATER_THAN", less, -0.5)  # within - is_camera_ray > -1/2
    mix = mixed_with_transparent(tree, output.inputs["Surface"].links[0].from_socket)
    tree.links.new(shown, mix.inputs[0])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])


def _math(
    tree: bpy.types.NodeTree, operation: str, first: bpy.types.NodeSocket, second: bpy.types.NodeSocket | float
) -> bpy.types.NodeSocket:
    """Output of an arithmetic node."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    tree.links.new(first, node.inputs[0])
    if isinstance(second, float):
        node.inputs[1].default_value = second
    else:
        tree.links.new(second, node.inputs[1])
    return node.outputs[0]


def mixed_with_transparent(tree: bpy.types.NodeTree, shown: bpy.types.NodeSocket) -> bpy.types.Node:
    """Mix node whose factor is the share of `shown`."""
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(shown, mix.inputs[2])
    return mix
