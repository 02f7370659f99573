# SPDX-License-Identifier: GPL-3.0-or-later
"""Test worlds, their picture by Cycles, and a job on the small scene."""

import tempfile
from pathlib import Path

import bpy
import numpy as np

from patchnet.operators.cycles.scene_copy import prepared, render
from patchnet.operators.pipeline.run import JobResult
from patchnet.patchnet_addon.image.cycles_passes import combined_light
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.blender.job_scene import ran
from patchnet.tests.blender.shaders import image, read_by, world

SIZE = (48, 32)


def gradient() -> None:
    """Red to the right, green ahead, blue above, each from 0 to 1."""
    tree = world()
    place, half = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
    half.operation, half.inputs[1].default_value, half.inputs[2].default_value = "MULTIPLY_ADD", [0.5] * 3, [0.5] * 3
    tree.links.new(place.outputs["Generated"], half.inputs[0])
    tree.links.new(half.outputs[0], tree.nodes["Background"].inputs["Color"])


def sky() -> None:
    """A sky texture with its sun in the picture."""
    tree = world()
    texture = tree.nodes.new("ShaderNodeTexSky")
    texture.sun_elevation, texture.sun_rotation, texture.sun_size = 0.15, 0.1, 0.2
    tree.links.new(texture.outputs[0], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = 0.1


def photograph() -> None:
    """An environment texture of 64 x 32 pixels."""
    tree = world()
    picture = image("Photograph", np.random.default_rng(1).random((32, 64, 4)))
    tree.links.new(read_by("TexEnvironment", image=picture)(tree), tree.nodes["Background"].inputs["Color"])


def backdrop() -> None:
    """Cameras see a gradient over the picture, all other rays a gray that lights."""
    tree = world()
    path, mix = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMixRGB")
    place = tree.nodes.new("ShaderNodeTexCoord")
    mix.inputs["Color1"].default_value = (0.3, 0.3, 0.3, 1.0)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs["Fac"])
    tree.links.new(place.outputs["Window"], mix.inputs["Color2"])
    tree.links.new(mix.outputs[0], tree.nodes["Background"].inputs["Color"])


def shown_by_cycles(camera: Camera, samples: int = 64) -> np.ndarray:
    """(P, 3) light of the world alone, as Cycles renders it through a camera."""
    hidden = [item for item in bpy.context.scene.objects if not item.hide_render and item.type == "MESH"]
    for item in hidden:
        item.hide_render = True
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "world.exr"
            with prepared(bpy.context, camera, samples, 1, path) as (scene, _):
                scene.render.film_transparent = False
                render(scene, path)
            return combined_light(read_exr(path)).reshape(-1, 3)
    finally:
        for item in hidden:
            item.hide_render = False


def run(**values: object) -> JobResult:
    return ran(depth=6, size=SIZE, light="two-lights", budget=0.5, **values)
