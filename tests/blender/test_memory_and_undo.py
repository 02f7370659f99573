# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of jobs and results; results across undo and redo."""

import gc
import tracemalloc

import bpy
import numpy as np
import pytest

from patchnet.operators.scene_access.images import free_copies, show_image
from patchnet.operators.session.scene_session import held, open_sessions
from patchnet.tests.blender.job_scene import drop_result_images, pixels_of, principled, result, run_small

pytestmark = pytest.mark.usefixtures("scene")


def held_bytes() -> int:
    """Bytes that the results of all scenes hold."""
    found = [session.result for session in open_sessions() if session.result is not None]
    return sum(result.octree.nbytes + result.coded.nbytes for result in found)


def array_bytes() -> int:
    """Bytes of all NumPy arrays made since tracing began."""
    gc.collect()
    mine = tracemalloc.DomainFilter(inclusive=True, domain=np.lib.tracemalloc_domain)
    return sum(item.size for item in tracemalloc.take_snapshot().filter_traces([mine]).statistics("filename"))


def test_a_job_holds_its_result_and_nothing_else(scene: bpy.types.Scene) -> None:
    run_small()  # compiles, and fills caches that stay
    bpy.ops.patchnet.clear_results()
    tracemalloc.start()
    try:
        run_small()
        made = result()
        its = made.octree.nbytes + made.coded.nbytes
        assert held_bytes() == its > 1_000_000
        spare = 200_000 + sum(array.nbytes for layer in made.coded.weights.arrays().values() for array in [layer])
        assert array_bytes() <= its + spare
        assert its <= held().results <= array_bytes() + spare
        del made
        bpy.ops.patchnet.clear_results()
        assert held_bytes() == 0 and array_bytes() < 200_000
    finally:
        tracemalloc.stop()


def test_failed_and_new_jobs_hold_nothing_more(scene: bpy.types.Scene) -> None:
    run_small()
    once = held_bytes()
    run_small()
    assert held_bytes() == once
    with pytest.raises(RuntimeError):
        run_small(cameras="Nobody")
    assert held_bytes() == once


def test_pictures_are_freed_and_read_again() -> None:
    pictures = {
        "Free me": np.random.default_rng(0).random((3, 5), np.float32),
        "Painted": np.full((3, 5), 0.25, np.float32),
    }
    images = {name: show_image(name, picture, raw=True) for name, picture in pictures.items()}
    try:
        before = held().images
        images["Painted"].pixels[0] = 0.75
        for image in images.values():
            free_copies(image)
        assert not images["Free me"].has_data and images["Painted"].has_data
        assert held().images == before // 2 and not images["Free me"].has_data
        assert np.array_equal(pixels_of(images["Free me"])[..., 0], pictures["Free me"])
        assert images["Painted"].pixels[0] == 0.75
    finally:
        drop_result_images()


def push(name: str) -> None:
    assert bpy.ops.ed.undo_push(message=name) == {"FINISHED"}


def undo() -> None:
    assert bpy.ops.ed.undo() == {"FINISHED"}
    bpy.context.view_layer.update()


def redo() -> None:
    assert bpy.ops.ed.redo() == {"FINISHED"}
    bpy.context.view_layer.update()


def test_undo_of_a_move_makes_results_fit_again() -> None:
    push("start")
    run_small()
    bpy.data.objects["Lath 1"].location.x += 0.3
    bpy.context.view_layer.update()
    push("move")
    assert result().stale == {"surface"}
    undo()
    assert result().stale == set()
    redo()
    assert result().stale == {"surface"}
    assert result().why("surface")


@pytest.mark.parametrize(
    ("step", "change", "what"),
    [
        ("surface", lambda: bpy.data.objects["Slab"].modifiers.new("Shell", "SOLIDIFY"), "'Slab'"),
        (
            "light",
            lambda: setattr(principled("Slab").inputs["Base Color"], "default_value", (1, 0, 0, 1)),
            "material 'Slab'",
        ),
    ],
)
def test_undo_to_before_a_result(step: str, change, what: str) -> None:
    """Results of a change do not fit any more when the change is undone."""
    push("start")
    change()
    bpy.context.view_layer.update()
    push("change")
    run_small()
    assert result().stale == set()
    undo()
    assert result().stale == {step}
    assert result().why(step) == f"{what} changed"
    redo()
    assert result().stale == set()


def test_pictures_and_voxels_that_an_undo_takes_away() -> None:
    drop_result_images()
    push("start")
    run_small()
    assert result().pictures
    bpy.ops.patchnet.show_voxels("EXEC_DEFAULT", True)
    count = len(bpy.data.objects["PatchNet Voxels"].data.vertices)
    undo()
    assert "PatchNet Voxels" not in bpy.data.objects
    assert result().stale == set()
    shown = any("patchnet_result" in image for image in bpy.data.images)
    assert result().pictures == shown
    redo()
    assert len(bpy.data.objects["PatchNet Voxels"].data.vertices) == count > 100 and result().stale == set()
