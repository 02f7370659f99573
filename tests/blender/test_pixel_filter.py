# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the render engine have the pixel filter of Cycles."""

from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from patchnet.operators.scene.pixel_filter import pixel_filter_of
from patchnet.patchnet_addon.tracing.pixel_filter import BLACKMAN_HARRIS, PixelFilter
from patchnet.tests.blender.engine_scene import build_for_engine, rendered
from patchnet.tests.blender.shaders import simple

FILTERS = [("BOX", 1.5), ("GAUSSIAN", 3.0), ("BLACKMAN_HARRIS", 1.5), ("BLACKMAN_HARRIS", 4.0)]


@pytest.fixture
def scene(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    """Boards that shine evenly, before black: all that pictures show is coverage."""
    scene = build_for_engine(weights, tmp_path)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    bpy.data.batch_remove([item for item in scene.objects if item.type == "MESH"])
    shining = simple("Emission", "Shining")
    for number in range(4):
        bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0.55 * number - 0.8, 0.0, 0.0))
        board = bpy.context.object
        board.rotation_euler, board.scale = (1.5708, 0.2 + 0.3 * number, 0.0), (0.3, 1.2, 1.0)
        board.data.materials.append(shining)
    scene.camera.location, scene.camera.rotation_euler = (0.0, -5.0, 0.0), (1.5708, 0.0, 0.0)
    scene.patchnet.light, scene.patchnet.depth, scene.patchnet.render_samples = "cycles", 12, 1024.0
    scene.patchnet.scope = "VISIBLE"
    return scene


def luminance(scene: bpy.types.Scene) -> np.ndarray:
    return rendered(scene)["Combined"][..., 1]


def test_edges_are_as_soft_as_those_of_cycles(scene: bpy.types.Scene) -> None:
    ours, theirs = {}, {}
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = 1024, False, False
    for engine, pictures in (("PATCHNET", ours), ("CYCLES", theirs)):
        scene.render.engine = engine
        for kind, width in FILTERS:
            scene.cycles.pixel_filter_type, scene.cycles.filter_width = kind, width
            pictures[kind, width] = luminance(scene)
    for name, picture in theirs.items():
        assert picture.max() > 0.8 and ((picture > 0.05) & (picture < 0.8)).mean() > 0.05
        errors = {other: float(np.sqrt(np.mean((mine - picture) ** 2))) for other, mine in ours.items()}
        own = errors.pop(name)
        assert own < 0.02 and own < 0.6 * min(errors.values()), "others differ by more than voxels thicken edges"


def test_without_cycles_it_is_that_of_eevee() -> None:
    scene = SimpleNamespace(render=SimpleNamespace(filter_size=2.5))
    assert pixel_filter_of(scene) == PixelFilter(BLACKMAN_HARRIS, 2.5)
