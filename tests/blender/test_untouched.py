# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators leave a user's file unchanged, data-block by data-block: finished, failed or stopped."""

import itertools
from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from patchnet.operators.pipeline.lit_octree import build_lit_octree
from patchnet.operators.pipeline.run import run_job
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.verify_light import CheckSettings, verify_light
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import Steps, drain
from patchnet.patchnet_addon.runtime.stage_clock import StageClock
from patchnet.tests.blender.full_scene import build_full
from patchnet.tests.blender.job_scene import drop_result_images
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("registered")

STOPS = 5  # of each kind of steps, spread evenly


CHANGES: dict[str, Callable[[], object]] = {
    "mode": lambda: bpy.ops.object.mode_set(mode="OBJECT"),
    "hidden": lambda: bpy.data.objects["Lath 1"].hide_set(False),
    "UV map": lambda: setattr(bpy.data.meshes["Lath 0"].uv_layers["Other"], "active", True),
    "driver": lambda: setattr(bpy.data.objects["Slab"].animation_data.drivers[0].driver, "expression", "1"),
    "painted image": lambda: bpy.data.images["Painted"].pixels.foreach_set([0.5] * 64),
    "other layer": lambda: setattr(bpy.context.scene.view_layers[1], "use_pass_z", False),
    "custom property": lambda: bpy.data.objects["Slab"].pop("note"),
    "handler": lambda: bpy.app.handlers.load_post.append(print),
}


def test_the_comparison_notices_each_change(tmp_path: Path) -> None:
    build_full(tmp_path, "EDIT")
    before = scene_snapshot()
    assert_unchanged(before)
    try:
        for name, change in CHANGES.items():
            change()
            now = scene_snapshot()
            assert now != before, name
            before = now
    finally:
        if print in bpy.app.handlers.load_post:
            bpy.app.handlers.load_post.remove(print)


def test_operators_that_do_their_work(weights: Path, tmp_path: Path) -> None:
    build_full(tmp_path, "WEIGHT_PAINT")
    bpy.context.scene.patchnet.weights = str(weights)
    before = scene_snapshot()
    for name, settings in (
        ("voxelize", {"depth": 5}),
        ("bake_light", {"max_samples": 2}),
        ("precompute_codes", {}),
        ("render_preview", {"size": (16, 16)}),
        ("run_all", {"depth": 5, "max_samples": 2, "size": (16, 16)}),
    ):
        assert getattr(bpy.ops.patchnet, name)(**settings) == {"FINISHED"}
        drop_result_images()
        assert_unchanged(before)


def job(**values: object) -> JobSettings:
    return JobSettings.of(**{"depth": 5, "size": (16, 16), "max_samples": 2, **values})


def bake() -> Steps[object]:
    return build_lit_octree(bpy.context, job(), StageClock())


@pytest.mark.parametrize("kind", ["run", "verify", "bake"])
def test_stopped_steps(kind: str, weights: Path, tmp_path: Path) -> None:
    build_full(tmp_path, "EDIT")
    kinds: dict[str, Callable[[], Steps[object]]] = {
        "run": lambda: run_job(bpy.context, job(weights=weights)),
        "verify": lambda: verify_light(bpy.context, CheckSettings(job(), render_samples=2, rays=2)),
        "bake": bake,
    }
    before = scene_snapshot()
    count = len(list(kinds[kind]()))
    assert_unchanged(before)
    for stop in range(0, count, max(1, count // STOPS)):
        steps = kinds[kind]()
        for _ in itertools.islice(steps, stop + 1):  # fewer where it goes on with the light of the one before
            pass
        steps.close()
        assert_unchanged(before)


# Where memory runs out: functions that stages call when they begin, and in their middle.
PLACES = (
    "operators.computing.grids.expected_leaves",
    "patchnet_addon.light.surfels.choose_surfels",
    "patchnet_addon.light.surface_light.cells_shade",
    "patchnet_addon.codes.encode.encode_octree",
)


@pytest.mark.parametrize("place", PLACES)
def test_memory_runs_out(place: str, weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build_full(tmp_path, "EDIT")
    before = scene_snapshot()

    def fail(*_values: object, **_named: object) -> None:
        raise MemoryError

    monkeypatch.setattr(f"patchnet.{place}", fail)
    with pytest.raises(RuntimeError, match="ran out of memory"):
        bpy.ops.patchnet.run_all(depth=5, max_samples=2, size=(16, 16), weights=str(weights))
    assert_unchanged(before)


def test_what_is_baked_is_deleted_meanwhile(tmp_path: Path) -> None:
    """By a handler of another add-on: an error, and all the rest as before."""
    build_full(tmp_path, "EDIT")
    before = scene_snapshot()

    def delete(*_values: object) -> None:
        if (item := bpy.data.objects.get("PatchNet Bake")) is not None:
            bpy.data.objects.remove(item)

    bpy.app.handlers.depsgraph_update_post.append(delete)
    try:
        with pytest.raises((ReferenceError, RuntimeError, SceneError)):
            drain(bake())
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(delete)
    assert_unchanged(before)
