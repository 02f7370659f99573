# SPDX-License-Identifier: GPL-3.0-or-later
"""Random places of objects: transforms, parents, instances of collections, vertices and faces, visibility."""

from __future__ import annotations

from math import cos, radians, sin
from random import Random

import bmesh
import bpy

from ....operators.demo_scene.geometry import add_object

_TURN_DEGREES = 137.5  # between one object and the next, as seeds of a sunflower, so that few objects overlap


def place(rng: Random, item: bpy.types.Object, number: int) -> None:
    """Place the object `number` around the origin, sometimes mirrored, sheared or instanced."""
    angle, far = radians(_TURN_DEGREES * number), 0.9 * number**0.5
    size = rng.uniform(0.5, 1.0)
    item.location = (far * cos(angle), far * sin(angle), rng.uniform(0.7, 1.5))
    item.rotation_euler = [rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6), rng.uniform(0.0, 6.0)]
    item.scale = (size,) * 3
    kind = rng.choices(
        ("", "mirrored", "stretched", "sheared", "collection", "vertices", "faces"), (12, 2, 2, 1, 2, 1, 1)
    )[0]
    if kind == "mirrored":
        item.scale = (-size, size, size)
    elif kind == "stretched":
        item.scale = (1.5 * size, size, 0.3 * size)
    elif kind == "sheared":
        _parent(item).scale = (1.0, 1.6, 0.7)
    elif kind == "collection":
        _instance_collection(rng, item)
    elif kind:
        _instance_on(item, "VERTS" if kind == "vertices" else "FACES")


def _parent(item: bpy.types.Object) -> bpy.types.Object:
    item.parent = add_object(bpy.context.scene.collection, f"Parent of {item.name}", None)
    return item.parent


def _instance_collection(rng: Random, item: bpy.types.Object) -> None:
    """Move the object into a collection, in the scene or not, of which there are two instances."""
    collection = bpy.data.collections.new(f"Collection of {item.name}")
    for other in item.users_collection:
        other.objects.unlink(item)
    collection.objects.link(item)
    if rng.random() < 0.4:
        bpy.context.scene.collection.children.link(collection)
        collection.hide_viewport = rng.random() < 0.3
    for side in (-1.0, 1.0):
        empty = add_object(bpy.context.scene.collection, f"Instance of {item.name}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location, empty.rotation_euler, empty.scale = (
            (side, 0.5 * side, 0.1),
            (0, 0, side),
            (0.7 * side, 0.7, 0.7),
        )


def _instance_on(item: bpy.types.Object, kind: str) -> None:
    """Instance the object at the vertices or faces of a small sheet, its parent."""
    mesh, shape = bpy.data.meshes.new("Points"), bmesh.new()
    bmesh.ops.create_grid(shape, x_segments=1, y_segments=1, size=1.2)
    shape.to_mesh(mesh)
    shape.free()
    points = add_object(bpy.context.scene.collection, f"Points of {item.name}", mesh)
    points.instance_type, points.location = kind, item.location
    item.location, item.parent = (0.0, 0.0, 0.0), points
    item.scale = 0.5 * item.scale


_RAYS = ("visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission", "visible_shadow")


def vary_visibility(rng: Random, item: bpy.types.Object) -> None:
    """Hide an object, sometimes, from viewports, renders, or rays of one kind."""
    kind = rng.choices(("", "hide_viewport", "hide_render", "hide", "ray", "holdout"), (16, 1, 1, 1, 2, 0.5))[0]
    if kind == "hide":
        if item.name in bpy.context.view_layer.objects:
            item.hide_set(True)
    elif kind == "ray":
        setattr(item, rng.choice(_RAYS), False)
    elif kind == "holdout":
        item.is_holdout = True
    elif kind:
        setattr(item, kind, True)
