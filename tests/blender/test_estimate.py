# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate: memory and time of a job, what does not fit, and when the estimate is outdated."""

import bpy
import pytest

from patchnet.operators.session import results
from patchnet.operators.session.scene_session import session_of
from patchnet.operators.ui.main import PATCHNET_PT_main
from patchnet.tests.blender.drawn import drawn, small_preview
from patchnet.tests.blender.objects import slid
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("scene")


def test_estimate(scene: bpy.types.Scene) -> None:
    before = scene_snapshot()
    assert bpy.ops.patchnet.estimate(depth=7, size=(24, 16), max_samples=4) == {"FINISHED"}
    assert_unchanged(before)
    found = session_of(scene).estimate
    assert results.result_of(scene) is None and found.expected.grid.depth == 7 and not found.too_large
    made = small_preview()
    assert found.expected.leaves == pytest.approx(made.octree.leaf_count, rel=0.3)
    assert found.expected.octree_bytes == pytest.approx(made.octree.nbytes, rel=0.3)
    assert found.codes_bytes == pytest.approx(made.coded.nbytes, rel=0.6)
    assert found.expected.lookahead_share == pytest.approx(made.lookahead_share, abs=0.1)
    assert found.expected.peak_bytes > found.expected.octree_bytes and found.paths > 0
    text = drawn(PATCHNET_PT_main)
    assert "6 objects, 72 triangles" in text and "Camera 'Eye' at 24 x 16" in text
    for line in found.lines:
        assert line in text


def test_estimate_says_what_does_not_fit(scene: bpy.types.Scene) -> None:
    assert bpy.ops.patchnet.estimate(depth=14, size=(24, 16), memory=0.25) == {"FINISHED"}
    assert session_of(scene).estimate.too_large
    assert "Does not fit into memory" in drawn(PATCHNET_PT_main)
    assert bpy.ops.patchnet.estimate(resolution="AUTO", size=(24, 16)) == {"FINISHED"}
    assert session_of(scene).estimate.fitted and not session_of(scene).estimate.too_large


def test_estimate_of_a_track(scene: bpy.types.Scene) -> None:
    """Of all its frames, not of the present one."""
    scene.frame_start, scene.frame_end = 1, 30
    scene.camera.data.lens = 200.0
    slid(scene.camera, {1: 0.5, 30: -1.5})
    scene.frame_set(1)
    wanted = {"resolution": "AUTO", "size": (96, 64), "light": "two-lights"}
    assert bpy.ops.patchnet.estimate(**wanted) == {"FINISHED"}
    alone = session_of(scene).estimate
    assert bpy.ops.patchnet.estimate(track=True, **wanted) == {"FINISHED"}
    found = session_of(scene).estimate
    assert "30 views of a track at 96 x 64" in drawn(PATCHNET_PT_main)
    assert bpy.ops.patchnet.run_all(track=True, **wanted) == {"FINISHED"}
    made = results.voxels_of(scene).octree.leaf_count
    assert 0.5 * made < found.expected.leaves < 1.3 * made and alone.expected.leaves < 0.9 * found.expected.leaves


def test_estimate_becomes_stale_and_says_why(scene: bpy.types.Scene) -> None:
    bpy.ops.patchnet.estimate(size=(24, 16))
    assert not any("Estimate again" in line for line in drawn(PATCHNET_PT_main))
    scene.patchnet.budget = 0.5  # has no part in it
    assert not any("Estimate again" in line for line in drawn(PATCHNET_PT_main))
    scene.patchnet.resolution = "DEPTH"
    assert "Estimate again: 'Voxel Detail' changed" in drawn(PATCHNET_PT_main)
    scene.patchnet.resolution = "AUTO"
    bpy.data.objects["Lath 2"].location.x += 0.1
    bpy.context.view_layer.update()
    assert "Estimate again: the scene may have changed" in drawn(PATCHNET_PT_main)
