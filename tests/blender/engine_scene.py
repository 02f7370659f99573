# SPDX-License-Identifier: GPL-3.0-or-later
"""The small scene for the render engine, and the passes of its renders."""

import itertools
from pathlib import Path

import bpy
import numpy as np

from patchnet.operators.render_engine.engine import ENGINE
from patchnet.operators.render_engine.passes import PASSES
from patchnet.operators.session import results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.tests.blender.job_scene import build
from patchnet.tests.blender.shaders import world

WIDTH, HEIGHT = 40, 26
WORLD = (0.1, 0.2, 0.4)
_numbers = itertools.count()


def build_for_engine(weights: Path, folder: Path) -> bpy.types.Scene:
    """The small scene before a grey-blue world, to be rendered by our engine into EXRs of all passes in a folder."""
    build()
    scene = bpy.context.scene
    values = scene.patchnet
    values.weights, values.light, values.resolution, values.depth = str(weights), "two-lights", "DEPTH", 6
    values.render_samples = 0.0  # by priority
    values.refined_samples = 1024.0  # so that refined pixels are those of the reference
    scene.cycles.pixel_filter_type = "BOX"  # so that rays count in their own pixel alone
    background = world().nodes["Background"]
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (*WORLD, 1.0), 0.5
    render = scene.render
    render.engine = ENGINE
    render.resolution_x, render.resolution_y, render.resolution_percentage = 2 * WIDTH, 2 * HEIGHT, 50
    exact_passes(render.image_settings)
    render.filepath = str(folder / "picture-")
    return scene


def kept(scene: bpy.types.Scene) -> SceneResult:
    """What the engine has made for a scene."""
    result = results.result_of(scene)
    assert result is not None and result.coded is not None
    return result


def exact_passes(settings: bpy.types.ImageFormatSettings) -> None:
    """All passes in one file, as they are."""
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth, settings.exr_codec = "32", "NONE"


def rendered(scene: bpy.types.Scene, **call: object) -> dict[str, np.ndarray]:
    """The passes (H, W, C) of a still."""
    path = Path(scene.render.filepath).parent / f"still-{next(_numbers)}.exr"
    scene.render.filepath = str(path)
    assert bpy.ops.render.render(write_still=True, **call) == {"FINISHED"}
    return passes_in(path)


def passes_in(path: Path) -> dict[str, np.ndarray]:
    """The passes (H, W, C) of the view layer in a render's file."""
    channels = {name: values for name, values in read_exr(path).items() if name.startswith("ViewLayer.")}
    return {
        item.name: np.stack([channels[f"ViewLayer.{item.name}.{letter}"] for letter in item.channels], axis=-1)
        for item in PASSES
        if f"ViewLayer.{item.name}.{item.channels[0]}" in channels
    }
