# SPDX-License-Identifier: GPL-3.0-or-later
"""Time estimates from measured jobs of this machine: rates, plans, estimates."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.estimate import estimate_job
from patchnet.operators.pipeline.job_work import FILE_NAME, Rates, light_paths, time_line, work_of
from patchnet.operators.pipeline.run import run_job
from patchnet.operators.settings.cycles_settings import CyclesSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.runtime.progress import Progress, drain
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.blender.job_scene import SMALL, build

STILL = Camera.look_at(np.zeros(3), np.ones(3), size_px=(400, 250))
FIGURES = {"triangles": 1000, "leaves": 1_000_000, "pixels": 100_000, "cameras": (STILL,)}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("patchnet.operators.pipeline.job_work.user_cache_folder", lambda: tmp_path)
    return tmp_path


def test_work_follows_what_is_asked_for() -> None:
    plain = work_of(JobSettings(), **FIGURES)
    few = work_of(JobSettings.of(max_samples=2), **FIGURES)["light"]
    assert plain["light"] / 4 < few < plain["light"] / 2, "surfels are chosen all the same"
    assert work_of(JobSettings.of(light="two-lights"), **FIGURES)["light"] == 0.0
    everywhere, fine = JobSettings.of(cells="everywhere"), FIGURES | {"leaves": 2_000_000}
    assert work_of(JobSettings(), **fine)["light"] < 1.5 * plain["light"]
    assert work_of(everywhere, **fine)["light"] == pytest.approx(2 * work_of(everywhere, **FIGURES)["light"])
    assert work_of(JobSettings.of(reference=True), **FIGURES)["views"] > 20 * plain["views"]
    assert work_of(JobSettings.of(refined_samples=1024.0), **FIGURES)["views"] > 3 * plain["views"]
    assert plain["cycles"] == 0.0 < work_of(JobSettings.of(cycles=CyclesSettings()), **FIGURES)["cycles"]


def test_paths_of_a_bake_follow_the_light_cells_that_cameras_need() -> None:
    """Within a factor of 1.5 of those that the courtyard's bakes had: 37 and 12.6 a pixel, 0.39 a leaf of a track."""
    still, small = STILL.with_size(480, 270), STILL.with_size(192, 192)
    for cameras, paths in (([small], 1.36e6), ([still] * 3, 4.89e6), ([still] * 60, 5.68e6)):
        assert paths / 1.5 < light_paths(JobSettings(), cameras, leaves=14_712_742) < paths * 1.5


def test_rates_are_those_of_jobs_that_were_done(cache: Path) -> None:
    work = work_of(JobSettings(), **FIGURES)
    rates = Rates()
    assert not rates.measured and "(measured elsewhere)" in time_line(rates.seconds(work), rates)
    rates.learn({"light": 1000.0}, {"light": 2.0})
    assert not Rates().measured, "starting Cycles took that time"
    rates.learn(work, {"light": 12.0, "codes": 3.0})
    again = Rates()
    assert again.measured and again.seconds(work)["light"] == pytest.approx(12.0)
    assert again.seconds({name: 2 * units for name, units in work.items()})["codes"] == pytest.approx(6.0)
    again.learn({"light": 9 * work["light"]}, {"light": 54.0})
    assert 54.0 < 9 * Rates().seconds(work)["light"] < 60.0, "the large job weighs more"
    (cache / FILE_NAME).write_text("not JSON")
    assert not Rates().measured
    (cache / FILE_NAME).unlink()
    (cache / FILE_NAME).mkdir()
    Rates().learn(work, {"light": 1.0})
    assert [path.name for path in cache.iterdir()] == [FILE_NAME], "what cannot be written is left"


@pytest.mark.usefixtures("registered")
def test_a_job_says_how_far_it_is_and_the_estimate_says_the_same(
    cache: Path, weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("patchnet.operators.pipeline.job_work._LEAST_S", 0.0)  # the job is small
    build()
    settings = JobSettings.of(max_samples=2, weights=weights, **SMALL)
    reports: list[Progress] = []
    result = drain(run_job(bpy.context, settings), reports.append)
    known = [report for report in reports if report.whole is not None]
    labels = {report.label.split()[0] for report in known}
    assert {"Baking", "Voxelizing", "Encoding", "Eye:"} <= labels and known[-1].label == reports[-1].label
    whole = [report.whole for report in known]
    assert whole == sorted(whole) and whole[0] >= 0.0 and whole[-1] < 1.0
    learned = json.loads((cache / FILE_NAME).read_text())
    assert {"light", "voxelize", "views"} & set(learned) and "cycles" not in learned
    for name, (seconds, _) in learned.items():
        assert seconds == pytest.approx(result.report["timings_s"][name])
    found = drain(estimate_job(bpy.context, settings))
    assert found.time_line in found.lines and "elsewhere" not in found.time_line
    cameras = [view.camera for view in result.views]
    figures = {"triangles": result.report["light"]["triangles"], "leaves": found.layers * found.expected.leaves}
    assert found.seconds == pytest.approx(Rates().seconds(work_of(settings, pixels=384, cameras=cameras, **figures)))
    for name, (seconds, _) in learned.items():
        assert found.seconds[name] == pytest.approx(seconds, rel=0.05), "the same job again"
