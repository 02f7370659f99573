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
from typing import Any

import bpy
import numpy as np

from ....operators.scene.read import read_scene
from ....operators.scene_access.blender_version import tree_in_use
from ....operators.scene_access.overrides import changed, put_back_when_saved
from ....operators.scene_access.temporary import temporary
from ....operators.schema.values import TWO_LIGHTS
from ....patchnet_addon.octree.grid import Grid
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.errors import SceneError

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
    from ....patchnet_addon.surface.shading import DIRECTION

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
    normal = _node(tree, "NewGeometry").outputs["True Normal"]
    cosine = _node(tree, "VectorMath", normal, direction.tolist(), operation="DOT_PRODUCT").outputs["Value"]
    strength = _node(tree, "Math", cosine, operation="ABSOLUTE").outputs[0]
    base = _node(tree, "Emission", _given(node.inputs[_BASE[node.type]]), strength).outputs[0]
    if node.type != "BSDF_PRINCIPLED":
        return base
    own = _node(tree, "Emission", _given(node.inputs["Emission Color"]), _given(node.inputs["Emission Strength"]))
    both = _node(tree, "AddShader", base, own.outputs[0]).outputs[0]
    return _seen(tree, both, _given(node.inputs["Alpha"]))


def _cut(tree: bpy.types.NodeTree, axis: int, beyond_world: float) -> None:
    """Make a material transparent for camera rays beyond a plane; behind it they still are camera rays."""
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None or not output.inputs["Surface"].is_linked:
        return  # invisible anyway
    parts = _node(tree, "SeparateXYZ", _node(tree, "NewGeometry").outputs["Position"])
    within = _node(tree, "Math", parts.outputs[axis], beyond_world, operation="LESS_THAN").outputs[0]
    from_camera = _node(tree, "LightPath").outputs["Is Camera Ray"]
    less = _node(tree, "Math", within, from_camera, operation="SUBTRACT").outputs[0]
    shown = _node(tree, "Math", less, -0.5, operation="GREATER_THAN").outputs[0]  # within - is_camera_ray > -1/2
    surface = output.inputs["Surface"]
    tree.links.new(_seen(tree, surface.links[0].from_socket, shown), surface)


def _seen(tree: bpy.types.NodeTree, shader: bpy.types.NodeSocket, share: Any) -> bpy.types.NodeSocket:
    """Output of a share of a shader, transparent for the rest."""
    return _node(tree, "MixShader", share, _node(tree, "BsdfTransparent").outputs[0], shader).outputs[0]


def _given(socket: bpy.types.NodeSocket) -> Any:
    """Socket that an input is linked to, or its value."""
    return socket.links[0].from_socket if socket.is_linked else socket.default_value


def _node(tree: bpy.types.NodeTree, kind: str, *inputs: Any, operation: str = "") -> bpy.types.Node:
    """New node; its first inputs are linked to sockets, or have values."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    if operation:
        node.operation = operation
    for target, given in zip(node.inputs, inputs, strict=False):
        if isinstance(given, bpy.types.NodeSocket):
            tree.links.new(given, target)
        else:
            target.default_value = given
    return node
