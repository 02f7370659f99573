# SPDX-License-Identifier: GPL-3.0-or-later
"""Object "PatchNet Voxels": one vertex a voxel of a level, and geometry nodes that make it a cube in its colour."""

from __future__ import annotations

import re

import bpy
import numpy as np
from mathutils import Matrix

from ...patchnet_addon.image.tone import srgb_encode
from ...patchnet_addon.octree.voxel_cloud import VoxelCloud
from ...patchnet_addon.runtime.errors import SceneError
from ..scene_access.blender_version import start_nodes
from ..scene_access.own import OWNER, check_own_scene

NAME = "PatchNet Voxels"
_GROUP = "PatchNet Voxels as Cubes"
_LUMINANCE, _SIDE = "luminance", "side"
_COLOR = "voxel_color"  # not "color": without that attribute nodes read the object's color, white
_SHOWN = "luminance_color"  # shown by Solid shading with Color: Attribute
_LIGHT_RAYS = ("diffuse", "glossy", "transmission", "volume_scatter", "shadow")


def show(scene: bpy.types.Scene, cloud: VoxelCloud) -> bpy.types.Object:
    """Show `cloud` as an object in `scene`, a cube for each voxel.

    The object of an earlier call gets new data and keeps its collection and visibility; a renamed one stays unchanged.
    A new object is hidden from renders. Selection and active object stay. Raises SceneError if the object is being
    edited, and as `check_own_scene`.
    """
    check_own_scene(scene)
    item = next((each for each in scene.objects if _is_ours(each)), None)
    if item is not None and item.mode != "OBJECT":
        raise SceneError(f"'{item.name}' is being edited: leave Edit Mode, or rename it to keep it")
    before = item.data if item is not None else None
    mesh = _mesh(cloud)
    if item is None:
        item = _new_object(scene, mesh)
    item.data = mesh
    item.matrix_world = Matrix.Identity(4)
    if before is not None and before.users == 0:
        bpy.data.meshes.remove(before)
    material = _own(bpy.data.materials, NAME) or _new_material()
    mesh.materials.append(material)
    group = _own(bpy.data.node_groups, _GROUP) or _new_group(material)
    modifier = next((each for each in item.modifiers if each.type == "NODES" and each.name == NAME), None)
    (modifier or item.modifiers.new(NAME, "NODES")).node_group = group
    return item


def _is_ours(item: bpy.types.Object) -> bool:
    """Test for PatchNet's object by its name; Blender appends a number if another scene has one."""
    return item.get(OWNER) == NAME and re.fullmatch(rf"{NAME}(\.\d+)?", item.name) is not None


def _own(blocks: bpy.types.bpy_prop_collection, name: str) -> bpy.types.ID | None:
    """PatchNet's data-block, created once per file; changes by the user are kept."""
    return next((item for item in blocks if item.get(OWNER) == name), None)


def _new_object(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """Create the object in the scene's own collection; if enabled for renders, it changes no light."""
    item = bpy.data.objects.new(NAME, mesh)
    item[OWNER] = NAME
    item.hide_render = True
    for ray in _LIGHT_RAYS:
        setattr(item, f"visible_{ray}", False)
    scene.collection.objects.link(item)
    return item


def _mesh(cloud: VoxelCloud) -> bpy.types.Mesh:
    """Vertices at the centres with their attributes."""
    mesh = bpy.data.meshes.new(NAME)
    mesh.vertices.add(len(cloud))
    mesh.vertices.foreach_set("co", cloud.centres_world.astype(np.float32).ravel())
    for name, values in ((_LUMINANCE, cloud.luminance), (_SIDE, cloud.side_world)):
        mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", values)
    mesh.attributes.new(_COLOR, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", cloud.color.ravel())
    colors = np.ones((len(cloud), 4), np.float32)
    colors[:, :3] = srgb_encode(cloud.color)
    mesh.attributes.new(_SHOWN, "BYTE_COLOR", "POINT").data.foreach_set("color_srgb", colors.ravel())
    mesh.attributes.active_color_name = _SHOWN
    return mesh


def _new_material() -> bpy.types.Material:
    """Emission of the voxels' colour, gray where the octree has luminance alone."""
    material = bpy.data.materials.new(NAME)
    material[OWNER] = NAME
    material.cycles.emission_sampling = "NONE"  # it lights no other object
    tree = start_nodes(material)
    tree.nodes.clear()
    color = tree.nodes.new("ShaderNodeAttribute")
    color.attribute_name = _COLOR
    emission = _node(tree, "ShaderNodeEmission", Color=color.outputs["Vector"])
    _node(tree, "ShaderNodeOutputMaterial", Surface=emission.outputs[0])
    _in_columns(tree)
    return material


def _new_group(material: bpy.types.Material) -> bpy.types.NodeTree:
    """Node group that turns points into cubes; its input Size scales them."""
    tree = bpy.data.node_groups.new(_GROUP, "GeometryNodeTree")
    tree[OWNER] = _GROUP
    tree.is_modifier = True
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    size = tree.interface.new_socket("Size", in_out="INPUT", socket_type="NodeSocketFloat")
    size.default_value, size.min_value, size.max_value = 1.0, 0.0, 1.0
    size.description = "Share of each voxel that is filled; less than 1 leaves gaps between them"
    given = tree.nodes.new("NodeGroupInput")
    attribute = _node(tree, "GeometryNodeInputNamedAttribute", Name=_SIDE)  # of floats, as new nodes are
    side = tree.nodes.new("ShaderNodeMath")
    side.operation = "MULTIPLY"
    for socket, factor in zip(side.inputs, (attribute.outputs["Attribute"], given.outputs["Size"]), strict=False):
        tree.links.new(factor, socket)
    cubes = _cubes(tree, given.outputs["Geometry"], side.outputs[0])
    coloured = _node(tree, "GeometryNodeSetMaterial", Geometry=cubes, Material=material)
    _node(tree, "NodeGroupOutput", Geometry=coloured.outputs["Geometry"])
    return _in_columns(tree)


def _cubes(tree: bpy.types.NodeTree, points: bpy.types.NodeSocket, side: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Cubes as one mesh, which the viewport draws faster than instances, and in colour in Solid shading, too.

    Solid shading shows the active color attribute. A joined mesh takes it from its first mesh, here a single vertex of
    the original, inside its own cube.
    """
    cube = _node(tree, "GeometryNodeMeshCube", Size=(1.0, 1.0, 1.0))
    instances = _node(tree, "GeometryNodeInstanceOnPoints", Points=points, Instance=cube.outputs["Mesh"], Scale=side)
    realized = _node(tree, "GeometryNodeRealizeInstances", Geometry=instances.outputs["Instances"])
    later = _node(tree, "FunctionNodeCompare", A=tree.nodes.new("GeometryNodeInputIndex").outputs[0], B=0.5)
    first = _node(tree, "GeometryNodeDeleteGeometry", Geometry=points, Selection=later.outputs["Result"])
    joined = tree.nodes.new("GeometryNodeJoinGeometry")
    for node in (realized, first):  # the mesh linked last comes first
        tree.links.new(node.outputs["Geometry"], joined.inputs["Geometry"])
    return joined.outputs["Geometry"]


def _node(tree: bpy.types.NodeTree, kind: str, **inputs: object) -> bpy.types.Node:
    node = tree.nodes.new(kind)
    for name, value in inputs.items():
        _set(tree, node.inputs[name], value)
    return node


def _set(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: object) -> None:
    """Link a socket, or set another value as the default."""
    if isinstance(value, bpy.types.NodeSocket):
        tree.links.new(value, socket)
    else:
        socket.default_value = value


def _in_columns(tree: bpy.types.NodeTree) -> bpy.types.NodeTree:
    """Tree with its nodes laid out in columns, in order of creation."""
    for index, node in enumerate(tree.nodes):
        node.location = (220 * (index // 2), -220 * (index % 2))
    return tree
