# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera-fitted octrees by operators and jobs: look-ahead in every pixel."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.scene.track import track_cameras
from patchnet.operators.session import results
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.blender.job_scene import drop_result_images, ran
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

SIZE = (50, 30)
LENS_MM = 480.0  # a long lens, so that few pixels need leaves on levels 8 to 10 of the small scene


@pytest.fixture(autouse=True)
def scene(scene: bpy.types.Scene) -> bpy.types.Scene:
    """The small scene with a narrow slab, so that it has few voxels on level 8, through a long lens."""
    scene.camera.data.lens = LENS_MM
    bpy.data.objects["Slab"].scale = (0.25, 1.0, 0.25)
    bpy.context.view_layer.update()
    return scene


def move_camera(scene: bpy.types.Scene) -> None:
    """A track of three frames, the last one from nearer."""
    eye = scene.camera
    scene.frame_start, scene.frame_end, scene.frame_step = 3, 5, 1
    for frame, place, turn in [(3, (0.3, -5.0, 0.4), (1.5, 0.0, 0.05)), (5, (-0.9, -2.5, 0.2), (1.5, 0.0, -0.33))]:
        eye.location, eye.rotation_euler = place, turn
        eye.keyframe_insert("location", frame=frame)
        eye.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_set(3)


def test_steps_one_by_one(scene: bpy.types.Scene) -> None:
    before = scene_snapshot()
    assert bpy.ops.patchnet.voxelize(resolution="AUTO", size=SIZE, scope="VISIBLE") == {"FINISHED"}
    unlit = results.voxels_of(scene)
    assert unlit.layout is not None and "up to" in unlit.summary[0]
    leaf_levels = np.unique(unlit.octree.level_of(np.flatnonzero(unlit.octree.child_mask == 0)))
    assert leaf_levels.min() == 8 and leaf_levels.max() == unlit.octree.depth > 8
    assert bpy.ops.patchnet.bake_light(light="two-lights") == {"FINISHED"}
    lit = results.voxels_of(scene)
    np.testing.assert_array_equal(lit.octree.child_mask, unlit.octree.child_mask)
    assert (lit.octree.luminance != unlit.octree.luminance).any() and lit.layout is unlit.layout
    assert bpy.ops.patchnet.precompute_codes() == {"FINISHED"}
    assert_unchanged(before)
    assert bpy.ops.patchnet.render_preview(size=SIZE) == {"FINISHED"}
    assert results.voxels_of(scene).lookahead_share > 0.98
    drop_result_images()


def test_a_track_serves_all_frames_and_leaves_the_scene_at_its_own(scene: bpy.types.Scene, weights: Path) -> None:
    move_camera(scene)
    scene.frame_set(4)
    before = scene_snapshot()
    result = ran(track=True, light="two-lights", size=SIZE, weights=weights)
    assert scene.frame_current == 4
    assert_unchanged(before)
    octree = result.coded.octree
    cameras = track_cameras(scene, (), SIZE)
    assert [camera.name for camera in cameras] == ["Eye, frame 3", "Eye, frame 4", "Eye, frame 5"]
    for camera in cameras:
        hits = first_hits(octree, camera)
        assert hits.hit.mean() > 0.1 and octree.look_ahead()[hits.node[hits.hit]].mean() > 0.98
    alone = ran(light="two-lights", size=SIZE, weights=weights)
    assert alone.coded.octree.leaf_count < octree.leaf_count


def test_a_camera_that_stands_still_is_one_view(scene: bpy.types.Scene) -> None:
    scene.frame_start, scene.frame_end = 1, 20
    assert len(track_cameras(scene, (), SIZE)) == 1


def test_a_small_memory_limit_is_said(scene: bpy.types.Scene, weights: Path) -> None:
    result = ran(light="two-lights", size=SIZE, weights=weights, memory=3_000_000 / 2**30)
    assert any("will have look-ahead" in warning for warning in result.warnings)
