# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes, lamps, cameras and instances for test scenes."""

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Vector

from patchnet.operators.scene.cameras import choose_cameras
from patchnet.operators.scene.read import read_scene
from patchnet.patchnet_addon.surface.scene_mesh import SceneMesh
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.blender.shaders import grey

SQUARE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def corners(low: Sequence[float], high: Sequence[float]) -> list[tuple[float, float, float]]:
    """Corners of a box, which CUBE_FACES joins."""
    return [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]


def link(item: bpy.types.Object, location: Sequence[float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    """Put a new object into the scene."""
    item.location = location
    bpy.context.scene.collection.objects.link(item)
    return item


def mesh(name: str, vertices: list, faces: list, paint: bpy.types.Material | None = None) -> bpy.types.Object:
    """A new mesh object, in no scene yet."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    if paint:
        data.materials.append(paint)
    return bpy.data.objects.new(name, data)


def cuboid(
    name: str, low: Sequence[float], high: Sequence[float], paint: bpy.types.Material | None = None
) -> bpy.types.Object:
    """A closed box in the scene."""
    return link(mesh(name, corners(low, high), CUBE_FACES, paint))


def slab(name: str = "Floor", paint: bpy.types.Material | None = None, low: Sequence[float] = (-1, -1),
         high: Sequence[float] = (1, 1)) -> bpy.types.Object:  # fmt: skip
    """A closed box whose top lies at z = 0: it has no back side that light from below could reach."""
    return cuboid(name, (*low, -0.2), (*high, 0.0), paint or grey())


def pane(name: str, paint: bpy.types.Material, z: float = 0.5, scale: Sequence[float] = (1, 1, 1)) -> bpy.types.Object:
    """A square above the surface, which reaches to x = 0 only: half of the surface is in its shadow."""
    item = link(mesh(name, SQUARE, [(0, 1, 2, 3)], paint), (1.0, 0.0, z))
    item.scale = scale
    return item


def read(scope: str = "VISIBLE") -> SceneMesh:
    """Surface of the open scene as it is now."""
    bpy.context.view_layer.update()
    return read_scene(bpy.context.evaluated_depsgraph_get(), scope)


def lamp(kind: str, energy: float, location: Sequence[float] = (0, 0, 1), **settings: object) -> bpy.types.Object:
    """A lamp that shines downwards."""
    light = bpy.data.lights.new(kind.title(), kind)
    light.energy = energy
    for name, value in settings.items():
        setattr(light, name, value)
    return link(bpy.data.objects.new(light.name, light), location)


def new_camera(name: str, place: Sequence[float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    """A new camera that looks down; the active one stays."""
    return link(bpy.data.objects.new(name, bpy.data.cameras.new(name)), place)


def look_from(place: Sequence[float], target: Sequence[float], name: str = "Eye") -> bpy.types.Object:
    """A new active camera that looks at a point."""
    eye = new_camera(name, place)
    eye.rotation_euler = (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.camera = eye
    return eye


def slid(item: bpy.types.Object, places: dict[int, float], axis: int = 0) -> None:
    """Key an object's places along an axis, by frame."""
    for frame, place in places.items():
        item.location[axis] = place
        item.keyframe_insert("location", index=axis, frame=frame)
    bpy.context.view_layer.update()


def active_camera(size: tuple[int, int] = (0, 0)) -> Camera:
    """The open scene's active camera, for pictures of a size, by default of the render's."""
    (camera,) = choose_cameras(bpy.context.evaluated_depsgraph_get(), (), size, np.zeros((2, 3)))
    return camera


def collection_instance(
    collection: bpy.types.Collection, name: str = "Instance", location: Sequence[float] = (0.0, 0.0, 0.0)
) -> bpy.types.Object:
    """A new empty that instances a collection."""
    empty = link(bpy.data.objects.new(name, None), location)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    return empty


def moved_to(collection: bpy.types.Collection, *items: bpy.types.Object) -> bpy.types.Collection:
    """The collection, which alone holds these objects now."""
    for item in items:
        for other in item.users_collection:
            other.objects.unlink(item)
        collection.objects.link(item)
    return collection


def group(name: str, *items: bpy.types.Object) -> bpy.types.Collection:
    """A new collection of the scene, which alone holds these objects now."""
    result = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(result)
    return moved_to(result, *items)


def geometry_nodes(
    item: bpy.types.Object, name: str = "Nodes"
) -> tuple[bpy.types.NodeTree, bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """New geometry nodes of an object: their tree, the geometry that comes in, and where what they make goes out."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    item.modifiers.new(name, "NODES").node_group = tree
    return tree, tree.nodes.new("NodeGroupInput").outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0]
