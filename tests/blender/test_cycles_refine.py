# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions by Cycles are bit for bit a full render's pixels, all others the preview's, and the scene stays as it was."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.cycles_refine import region_renders as renders
from patchnet.operators.cycles_refine.refine import CyclesView, cycles_view
from patchnet.operators.cycles_refine.settings import COMBINED, CyclesSettings
from patchnet.operators.job.run import run_job
from patchnet.operators.job.settings import JobSettings
from patchnet.patchnet_addon.errors import SettingError
from patchnet.patchnet_addon.progress import Steps, drain
from patchnet.patchnet_addon.sampling.regions import region_mask
from patchnet.tests.blender.full_scene import build_full
from patchnet.tests.blender.job_scene import build, drop_result_images, saved
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("registered")

SIZE = (40, 24)
CYCLES = CyclesSettings(budget=0.4, samples=4, tile=8, most=3, compare=True)
STOPS = 6


def job(weights: Path, cycles: CyclesSettings | None = CYCLES, **values: object) -> JobSettings:
    given = {"depth": 7, "samples": 1, "size": SIZE, "weights": weights, "cycles": cycles}
    return JobSettings(**{**given, **values})


@pytest.mark.parametrize(("light", "color"), [(True, False), (False, True)])
def test_inside_is_the_full_render_and_outside_the_preview(light: bool, color: bool, weights: Path) -> None:
    build(light=light)
    before = scene_snapshot()
    result = drain(run_job(bpy.context, job(weights, color=color)))
    assert_unchanged(before)
    (view,) = result.cycles
    assert view.full is not None
    assert view.composited.shape == ((24, 40, 3) if color else (24, 40))
    np.testing.assert_array_equal(view.composited[view.mask], view.full[view.mask])
    np.testing.assert_array_equal(view.composited[~view.mask], view.preview[~view.mask])
    assert (view.composited[view.mask] != view.preview[view.mask]).any(), "Cycles' pixels are others"
    assert view.composited.max() > 0.2
    check_figures(view)
    assert result.report["frames"][0]["cycles"] is view.report


def check_figures(view: CyclesView) -> None:
    report = view.report
    np.testing.assert_array_equal(view.mask, region_mask(list(view.regions), 24, 40))
    assert 0.2 < report["pixels_share"] == view.mask.mean() <= CYCLES.budget
    assert report["priority_share"] > report["pixels_share"], "regions are where priority is"
    seconds = report["seconds"]
    assert 0.0 < seconds["of_that_reading_the_scene"] < seconds["regions"] and seconds["full"] > 0.0
    mse = report["mse"]
    assert mse["full"] < mse["composited"] < mse["preview"]
    assert mse["composited_over_refined_octree"] <= mse["refined_octree"]
    json.dumps(report, allow_nan=False)


def test_regions_are_rendered_at_once_or_in_parts_with_the_same_bits(
    weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build()
    settings = CyclesSettings(budget=0.5, samples=4, tile=8)
    whole = drain(run_job(bpy.context, job(weights, settings))).cycles[0]
    monkeypatch.setattr(renders, "_FIRST_PATHS", 100)
    monkeypatch.setattr(renders, "_PART_S", 0.0)
    labels = []
    parts = drain(run_job(bpy.context, job(weights, settings)), lambda report: labels.append(report.label)).cycles[0]
    np.testing.assert_array_equal(parts.composited, whole.composited)
    assert parts.full is None and parts.errors == {}
    assert sum("regions" in label for label in labels) > len(parts.regions)


def test_a_budget_of_nothing_and_of_all(weights: Path) -> None:
    build()
    nothing = drain(run_job(bpy.context, job(weights, CyclesSettings(budget=0.0, samples=1)))).cycles[0]
    np.testing.assert_array_equal(nothing.composited, nothing.preview)
    assert nothing.report["seconds"]["regions"] == 0.0
    combined = CyclesSettings(budget=1.0, samples=1, tile=64, light=COMBINED, compare=True)
    everything = drain(run_job(bpy.context, job(weights, combined))).cycles[0]
    assert everything.mask.all()
    np.testing.assert_array_equal(everything.composited, everything.full)


def test_stopped_anywhere_the_scene_is_as_before(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build_full(tmp_path, "EDIT")
    result = drain(run_job(bpy.context, job(weights, None)))
    view, octree = result.views[0], result.coded.octree
    before = scene_snapshot()

    def steps() -> Steps[CyclesView]:
        return cycles_view(bpy.context, octree, view.camera, view.frame, view.priority.ravel(), CYCLES)

    count = len(list(steps()))
    assert_unchanged(before)
    for stop in range(0, count, max(1, count // STOPS)):
        stopped = steps()
        for _ in range(stop + 1):
            next(stopped)
        stopped.close()
        assert_unchanged(before)
    calls = []

    def fails(path: Path) -> dict[str, np.ndarray]:
        calls.append(path)
        if len(calls) == 3:
            raise MemoryError
        return read(path)

    read = renders.read_exr
    monkeypatch.setattr(renders, "read_exr", fails)
    with pytest.raises(MemoryError):
        drain(steps())
    assert_unchanged(before)


def test_operator_leaves_pictures_and_nothing_else(weights: Path, tmp_path: Path) -> None:
    build_full(tmp_path, "OBJECT")
    bpy.context.scene.patchnet.weights = str(weights)
    with pytest.raises(RuntimeError, match="no codes"):
        bpy.ops.patchnet.refine_with_cycles()
    bpy.ops.patchnet.run_all(depth=7, samples=1, size=SIZE)
    drop_result_images()
    before = scene_snapshot()
    values = {"cycles_budget": 0.3, "cycles_samples": 2, "cycles_tile": 8, "cycles_compare": True}
    assert bpy.ops.patchnet.refine_with_cycles(size=SIZE, **values) == {"FINISHED"}
    name = bpy.context.scene.camera.name
    for kind in ("cycles", "regions", "cycles full"):
        assert tuple(bpy.data.images[f"PatchNet {name} {kind}"].size) == SIZE
    assert f"PatchNet {name} cycles error" in bpy.data.images
    drop_result_images()
    assert_unchanged(before)


def test_light_that_is_not_cycles_is_refused(weights: Path) -> None:
    build()
    bpy.ops.patchnet.run_all(depth=5, light="two-lights", size=(16, 16), weights=str(weights))
    with pytest.raises(RuntimeError, match="bake the light with Cycles"):
        bpy.ops.patchnet.refine_with_cycles()
    with pytest.raises(SettingError, match="two-lights"):
        job(weights, light="two-lights")


def test_the_command_writes_pictures_and_figures(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    build()
    scene, out = saved(tmp_path / "small.blend"), tmp_path / "out"
    arguments = ["--depth", "7", "--samples", "1", "--size", "40", "24", "--weights", str(weights)]
    cycles = ["--cycles-budget", "0.4", "--cycles-samples", "2", "--cycles-tile", "8", "--cycles-compare"]
    assert commands.main(["run", str(scene), "--out", str(out), *arguments, *cycles]) == 0
    printed = capsys.readouterr().out
    assert "Cycles on" in printed and "full Cycles render" in printed
    report = json.loads((out / "report.json").read_text())["frames"][0]["cycles"]
    assert report["samples"] == 2 and report["reference_samples"] == 8
    names = {path.name for path in (out / "Eye").iterdir()}
    assert {"cycles.png", "regions.png", "cycles_full.png", "cycles_error.png", "cycles_compare.png"} <= names


@pytest.mark.parametrize(
    "wrong", [{"budget": 1.5}, {"samples": 0}, {"tile": 0}, {"most": 0}, {"light": "glossy"}], ids=str
)
def test_settings_outside_their_range_are_refused(wrong: dict) -> None:
    with pytest.raises(SettingError):
        CyclesSettings(**wrong)
