# SPDX-License-Identifier: GPL-3.0-or-later
"""Corridor of 16 m with a lamp at each end and a box that is moved, for incremental bakes."""

import bmesh
import bpy

from patchnet.operators.demo_scene.geometry import box, place
from patchnet.operators.demo_scene.materials import principled

LENGTH, WIDTH, HEIGHT = 16.0, 3.0, 2.5
BOX = "Box"


def build_corridor(pieces: int = 3) -> bpy.types.Object:
    """Build the corridor, whose faces are divided `pieces` times, and return the box that stands at its end."""
    matt = principled("Matt", (0.5, 0.5, 0.5), roughness=1.0, specular=0.0)
    scene = bpy.context.scene
    shell = place(scene.collection, "Corridor", box((0.0, 0.0, 0.0), (LENGTH, WIDTH, HEIGHT)), matt)
    subdivide(shell, pieces, inside_out=True)
    for number, x in enumerate((2.0, LENGTH - 2.0)):
        data = bpy.data.lights.new("Lamp", "POINT")
        data.energy, data.shadow_soft_size = 60.0, 0.1
        lamp = bpy.data.objects.new(f"Lamp {number}", data)
        lamp.location = (x, WIDTH / 2, HEIGHT - 0.3)
        scene.collection.objects.link(lamp)
    item = place(scene.collection, BOX, box((-0.25, -0.25, 0.0), (0.25, 0.25, 0.5)), matt)
    item.location = (2.5, 1.2, 0.0)
    scene.world = None
    bpy.context.view_layer.update()
    return item


def subdivide(item: bpy.types.Object, times: int, *, inside_out: bool = False) -> None:
    """Divide each edge of an object's mesh in 2 to the power of `times`."""
    mesh = bmesh.new()
    mesh.from_mesh(item.data)
    if inside_out:
        bmesh.ops.reverse_faces(mesh, faces=mesh.faces)
    bmesh.ops.subdivide_edges(mesh, edges=mesh.edges, cuts=(1 << times) - 1, use_grid_fill=True)
    mesh.to_mesh(item.data)
    mesh.free()
