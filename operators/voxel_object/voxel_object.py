# SPDX-License-Identifier: GPL-3.0-or-later
"""Object "PatchNet Voxels": one vertex a voxel, and a modifier that gives it its shape."""

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
from .node_groups import SIDE, cubes_group, points_group

_NAME = "PatchNet Voxels"
LUMINANCE = "luminance"
COLOR = "voxel_color"  # "color" would be the object's own, white, where it is not there


def voxel_material() -> bpy.types.Material:
    """Material of shown voxels, made once a file; what a user changes in it stays."""
    material = next((item for item in bpy.data.materials if item.get(OWNER) == _NAME), None)
    return material or _new_material()


def _new_material() -> bpy.types.Material:
    """Emission of the voxels' colour, gray where the octree has luminance alone.

    On points and real cubes the attribute is the geometry's, on instances theirs; one that is not there reads 0, so the
    sum is whichever there is.
    """
    material = bpy.data.materials.new(_NAME)
    material[OWNER] = _NAME
    material.cycles.emission_sampling = "NONE"  # nothing else in the scene is lit by it
    tree = start_nodes(material)
    tree.nodes.clear()
    total = tree.nodes.new("ShaderNodeVectorMath")
    for index, kind in enumerate(("GEOMETRY", "INSTANCER")):
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name, attribute.attribute_type = COLOR, kind
        attribute.location = (-400, -200 * index)
        tree.links.new(attribute.outputs["Vector"], total.inputs[index])
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    total.location, emission.location, output.location = (-200, 0), (0, 0), (200, 0)
    tree.links.new(total.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


NAME = "PatchNet Voxels"
CUBES = "CUBES"
POINTS = "POINTS"
_SHOWN = "luminance_color"  # what the viewport's solid mode shows for Color: Attribute
_LIGHT_RAYS = ("diffuse", "glossy", "transmission", "volume_scatter", "shadow")


def show(scene: bpy.types.Scene, cloud: VoxelCloud, display: str) -> bpy.types.Object:
    """Show `cloud` in `scene` by an object, as CUBES or POINTS.

    The one of an earlier call is filled anew and stays in its collection, with its visibility; a renamed one is kept as
    it is. A new one is hidden from renders. Selection and active object stay. Raises SceneError if it is being edited,
    and as `check_own_scene`.
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
    material = voxel_material()
    mesh.materials.append(material)
    _modifier(item).node_group = (cubes_group if display == CUBES else points_group)(material)
    return item


def _is_ours(item: bpy.types.Object) -> bool:
    """Test for our object under its own name; Blender appends a number where another scene has the same one."""
    return item.get(OWNER) == NAME and re.fullmatch(rf"{NAME}(\.\d+)?", item.name) is not None


def _new_object(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """Create the object in the scene's own collection; where a user enables it for renders, it changes no light."""
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
    for name, values in ((LUMINANCE, cloud.luminance), (SIDE, cloud.side_world)):
        mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", values)
    mesh.attributes.new(COLOR, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", cloud.color.ravel())
    colors = np.ones((len(cloud), 4), np.float32)
    colors[:, :3] = srgb_encode(cloud.color)
    mesh.attributes.new(_SHOWN, "BYTE_COLOR", "POINT").data.foreach_set("color_srgb", colors.ravel())
    mesh.attributes.active_color_name = _SHOWN
    return mesh


def _modifier(item: bpy.types.Object) -> bpy.types.Modifier:
    """Geometry nodes modifier that is ours; others stay."""
    found = next((each for each in item.modifiers if each.type == "NODES" and each.name == NAME), None)
    return found or item.modifiers.new(NAME, "NODES")
