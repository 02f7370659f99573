# SPDX-License-Identifier: GPL-3.0-or-later
"""A small scene that exercises the whole job in a second or two: laths before a slab, a lamp, a camera."""

from pathlib import Path

import bpy

from patchnet.operators.session import results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.patchnet_addon.network.weights import Weights, save_weights

SMALL = {"depth": 7, "size": (24, 16)}
# A stand-in for the program Blender, where it is a Python module.
SHIM = """#!/bin/sh
test "$1 $2" = "--command patchnet" || exit 99
shift 2
exec {python} -c 'import os, sys, bpy; from patchnet.commands.blender_command import execute
code = execute(sys.argv[1:]); sys.stdout.flush(); os._exit(code)' "$@"
"""
QUICK = ["--light", "two-lights", "--size", "16", "16", "--depth", "5"]  # words of a command


def box(name: str, low: tuple[float, float, float], high: tuple[float, float, float], gray: float) -> bpy.types.Object:
    """A box with one material of the given gray."""
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (gray, gray, gray, 1.0)
    mesh.materials.append(material)
    item = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(item)
    return item


def build(light: bool = True, camera: bool = True) -> None:
    """Replace what is open by the small scene; the slab is selected, the laths are not."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    slab = box("Slab", (-1, 0.5, -1), (1, 0.6, 1), 0.2)
    for index in range(5):
        box(f"Lath {index}", (-0.9 + 0.4 * index, -0.5, -1), (-0.85 + 0.4 * index, -0.45, 1), 0.9)
    if light:
        lamp = bpy.data.lights.new("Lamp", "SUN")
        lamp.energy = 3.0
        item = bpy.data.objects.new("Lamp", lamp)
        item.rotation_euler = (0.9, 0.2, 0.1)
        scene.collection.objects.link(item)
    if camera:
        eye = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
        eye.location, eye.rotation_euler = (0.3, -5.0, 0.4), (1.5, 0.0, 0.05)
        scene.collection.objects.link(eye)
        scene.camera = eye
    for item in scene.objects:
        item.select_set(item is slab)
    bpy.context.view_layer.objects.active = slab
    bpy.context.view_layer.update()


def principled(name: str) -> bpy.types.Node:
    """The shader of a material."""
    return bpy.data.materials[name].node_tree.nodes["Principled BSDF"]


def saved(path: Path) -> Path:
    """Save what is open as a .blend file; its path."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def random_weights(folder: Path, lookahead: int = 2) -> Path:
    """A file of untrained weights."""
    path = folder / "random.safetensors"
    save_weights(Weights.random(3, bias=0.1, lookahead=lookahead), path)
    return path


def drop_result_images() -> None:
    """Remove the pictures that operators are meant to leave."""
    for image in list(bpy.data.images):
        if image.get("patchnet_result"):
            bpy.data.images.remove(image)


def run_small(**values: object) -> None:
    """Run all stages on the open scene, in the two lights unless `values` say otherwise."""
    assert bpy.ops.patchnet.run_all(**{"light": "two-lights", **SMALL, **values}) == {"FINISHED"}


def result() -> SceneResult:
    """What the open scene has of such a job."""
    return results.voxels_of(bpy.context.scene)
