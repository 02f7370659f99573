# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs and renders redo outdated stages and nothing else."""

from pathlib import Path

import bpy
import pytest

from patchnet.tests.blender.job_scene import random_weights, result, run_small

pytestmark = pytest.mark.usefixtures("scene")


def test_preview_selection_makes_what_is_stale_and_nothing_else(weights: Path, tmp_path: Path) -> None:
    """With nothing stale only the view, with other light the same grid, with another surface all."""
    wanted: dict[str, object] = {"scope": "SELECTED", "weights": str(weights)}

    def made(**values: object) -> tuple[bool, bool, bool]:
        """Whether voxels stay, their grid, and look-ahead."""
        before = result()
        wanted.update(values)
        run_small(**wanted)
        now = result()
        assert now.stale == set() and now.pictures
        return now.octree is before.octree, now.octree.grid == before.octree.grid, now.coded is before.coded

    run_small(**wanted)
    assert made() == (True, True, True)
    assert made(budget=0.1) == (True, True, True)
    bpy.data.objects["Eye"].location.x += 0.1
    assert made(size=(16, 16)) == (True, True, True)
    assert made(weights=str(random_weights(tmp_path))) == (True, True, False)
    bpy.data.lights["Lamp"].energy = 9.0
    bpy.context.view_layer.update()
    assert made() == (False, True, False)
    assert made(light="cycles", max_samples=2) == (False, True, False)
    bpy.data.objects["Slab"].location.x += 0.1
    bpy.context.view_layer.update()
    assert made() == (False, False, False)
    bpy.data.objects["Lath 4"].select_set(True)
    assert made() == (False, False, False)
    assert made() == (True, True, True)
    wanted.pop("depth", None)
    assert made(resolution="AUTO") == (False, False, False)
    assert made() == (True, True, True)
    bpy.data.objects["Eye"].location.y += 2.0
    assert made() == (False, True, False), "voxels are fitted to where the camera stands"


def test_a_selection_without_a_surface_keeps_the_objects_and_another_one_is_told() -> None:
    """A lamp is what one has selected after one has moved it."""
    run_small(scope="SELECTED")
    before = result().octree.leaf_count
    for item in bpy.context.selected_objects:
        item.select_set(False)
    bpy.data.objects["Lamp"].select_set(True)
    bpy.data.lights["Lamp"].energy = 9.0
    bpy.context.view_layer.update()
    assert bpy.ops.patchnet.bake_light(light="cycles", max_samples=2) == {"FINISHED"}
    assert result().octree.leaf_count == before and result().stale == set()
    bpy.data.lights["Lamp"].energy = 5.0
    bpy.context.view_layer.update()
    run_small(scope="SELECTED")
    assert result().octree.leaf_count == before and not any("selected object" in text for text in result().all_notes)
    bpy.data.objects["Lath 4"].select_set(True)
    run_small(scope="SELECTED")
    assert result().octree.leaf_count != before
    assert [text for text in result().all_notes if text.startswith("The voxels are of 1 selected object now")]


def test_a_change_that_is_taken_back_does_not_hold_up_a_render() -> None:
    """Marked by a change, and disproved by a comparison when a frame is rendered."""
    run_small()
    octree = result().octree
    slab = bpy.data.objects["Slab"]
    slab.location.x += 0.5
    bpy.context.view_layer.update()
    assert result().stale == {"surface"}
    slab.location.x -= 0.5
    bpy.context.view_layer.update()
    scene = bpy.context.scene
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PATCHNET", 8, 8
    bpy.ops.render.render()
    assert result().octree is octree and result().stale == set()
