# SPDX-License-Identifier: GPL-3.0-or-later
"""Animations of the render engine: light and world are those of each frame, and data-blocks stay as they were."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.render_engine.passes import NO_DEPTH
from patchnet.operators.session import results
from patchnet.operators.session.scene_session import session_of
from patchnet.tests.blender.engine_scene import build_for_engine, passes_in, rendered


@pytest.fixture(autouse=True)
def scene(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    return build_for_engine(weights, tmp_path)


@pytest.mark.parametrize("moving", [True, False], ids=["all of it", "the world alone"])
def test_what_is_baked_is_lit_as_at_its_frame(scene: bpy.types.Scene, moving: bool) -> None:
    """Against a still of the same frame: Blender leaves data-blocks as they are while it goes from frame to frame."""
    scene.patchnet.light, scene.patchnet.samples = "cycles", 64
    lath, lamp = scene.objects["Lath 2"], bpy.data.lights.new("Lamp", "SUN")
    scene.collection.objects.link(bpy.data.objects.new("Lamp", lamp))
    strength = scene.world.node_tree.nodes["Background"].inputs["Strength"]
    for frame, x, energy, world in ((1, 0.0, 1.0, 0.5), (2, 0.3, 3.0, 1.0)):
        strength.default_value = world
        strength.keyframe_insert("default_value", frame=frame)
        if moving:
            lath.location.x, lamp.energy = x, energy
            lath.keyframe_insert("location", index=0, frame=frame)
            lamp.keyframe_insert("energy", frame=frame)
    scene.frame_start, scene.frame_end = 1, 2
    scene.frame_set(1)
    before = lath.location.x, lamp.energy
    folder = Path(scene.render.filepath).parent
    bpy.ops.render.render(animation=True)
    assert (lath.location.x, lamp.energy, strength.default_value) == (*before, 0.5), "as the scene was left"
    begin, end = (passes_in(folder / f"picture-{frame:04d}.exr") for frame in (1, 2))
    first, second = begin["Combined"], end["Combined"]
    surface = (begin["Depth"] < NO_DEPTH)[..., 0]
    assert np.abs(second - first)[surface, :3].max(axis=-1).mean() > 0.08, "not of the background alone"
    results.forget(scene)
    session_of(scene).made_frame = None
    scene.frame_set(2)
    assert np.abs(second - rendered(scene)["Combined"]).mean() < 0.004, "but for noise"
