# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of engine_window.py: the render engine in a window."""

from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.tests.real_blender.executable import Blender

# A cube under a sky that is brighter in each frame, in light that needs no bake; and its frames without a window.
SKY = """
import bpy
bpy.ops.wm.read_homefile(use_empty=True)
scene = bpy.context.scene
bpy.ops.mesh.primitive_cube_add(size=1.0)
bpy.ops.object.camera_add(location=(0.0, -5.0, 0.0), rotation=(1.7, 0.0, 0.0))
scene.camera = bpy.context.object
scene.world = bpy.data.worlds.new("Sky")
scene.world.use_nodes = True
nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
sky = nodes.new("ShaderNodeTexSky")
sky.sun_disc = False
links.new(sky.outputs["Color"], nodes["Background"].inputs["Color"])
strength = nodes["Background"].inputs["Strength"]
for frame in (1, 2, 3):
    strength.default_value = 0.1 * frame
    strength.keyframe_insert("default_value", frame=frame)
scene.render.engine = "PATCHNET"
scene.patchnet.light, scene.patchnet.resolution, scene.patchnet.depth = "two-lights", "DEPTH", 5
scene.frame_end = 3
scene.frame_set(1)
values = scene.render
values.resolution_x, values.resolution_y, values.resolution_percentage = 64, 48, 100
if hasattr(values.image_settings, "media_type"):
    values.image_settings.media_type = "IMAGE"
values.image_settings.file_format, values.image_settings.color_depth = "OPEN_EXR", "32"
values.image_settings.exr_codec = "NONE"
values.filepath = OUT + "/sky-background-"
bpy.ops.wm.save_as_mainfile(filepath=OUT + "/sky.blend")
bpy.ops.render.render(animation=True)
"""


@pytest.fixture(scope="module")
def seen(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of engine_window.py."""
    installed.execute(f"exec({SKY!r}, {{'OUT': {str(out)!r}}})")
    return installed.visit("engine", out, file=courtyard)


def test_the_viewport_refines_while_it_stands_still(seen: dict) -> None:
    assert seen["coarse at first"]
    assert seen["finest"] == 1024 and 0.0 < seen["refined share"] < 0.005


def test_the_viewport_shows_the_world_behind_objects(seen: dict) -> None:
    """A gradient that is black nowhere."""
    assert seen["sky"]["share"] > 0.01 and seen["sky"]["least"] > 0.0 and seen["sky"]["spread"] > 0.001


def test_a_picture_goes_on_while_the_world_is_looked_at(seen: dict) -> None:
    assert seen["begun anew"] == 0


def test_a_picture_begins_anew_when_the_engine_has_ended(seen: dict) -> None:
    assert seen["refined after the engine's end"] == 1024


def test_leaving_the_shading_mode_frees_the_picture(seen: dict) -> None:
    assert seen["references left"] == 3  # the script's list, its variable, and the question itself


def test_f12_renders_beside_the_window(seen: dict) -> None:
    assert "Black is shown behind objects" not in seen["said"]
    assert seen["render"] == "complete" and ["IMAGE_EDITOR"] in seen["windows"]


def test_the_sky_is_there_in_the_first_frame_and_in_all_of_an_animation(seen: dict, out: Path) -> None:
    """As without a window, where Cycles is asked for each pixel; here for a map of all directions."""
    assert seen["sky at once"] == "complete"
    pairs = [("at-once", 1), *((f"window-{frame:04}", frame) for frame in (1, 2, 3))]
    for name, frame in pairs:
        shown, known = (picture(out / f"sky-{item}.exr") for item in (name, f"background-{frame:04}"))
        beside = np.s_[:, :10]  # columns of the sky alone
        assert known[beside].min() > 0.0, frame
        off = np.abs(shown[beside] / known[beside] - 1.0)  # a map has pixels of its own at the horizon
        assert off.mean() < 0.02 and np.median(off) < 0.01, name


def picture(path: Path) -> np.ndarray:
    """(H, W, 3) of a file."""
    channels = read_exr(path)
    return np.dstack([next(values for name, values in channels.items() if name.split(".")[-1] == c) for c in "RGB"])


def test_voxels_that_do_not_fit_are_shown_with_a_warning(seen: dict) -> None:
    assert seen["render of old voxels"] == "complete"
    assert any("the scene changed since it was voxelized" in text for text in seen["said of old voxels"])


def test_without_voxels_nothing_breaks(seen: dict) -> None:
    assert seen["render without voxels"] in ("complete", "cancel")


def test_viewports_refine_where_masks_are_white(seen: dict) -> None:
    """Looking through the camera, whose picture is in the middle of the view; after strokes the preview starts anew."""
    left, right = seen["mask left"]["columns"], seen["mask right"]["columns"]
    assert 0.1 < left[0] < left[1] < 0.51 and 0.49 < right[0] < right[1] < 0.9


def test_viewports_find_weights_on_what_renders_show(seen: dict) -> None:
    """With a subdivision that is finer in renders than in viewports, where it stays as it was."""
    assert seen["levels before"] == seen["levels after"] == 1
    assert seen["mask group"]["heaviest"] == 1.0 and seen["mask lighter group"]["heaviest"] == 0.5
    assert 0.001 < seen["mask group"]["matter"] == seen["mask lighter group"]["matter"] < 0.2
