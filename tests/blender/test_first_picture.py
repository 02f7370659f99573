# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished pictures during a job: first rays before the bake, heatmap, refinement."""

from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from patchnet.operators import overlay
from patchnet.operators.computing import views
from patchnet.operators.overlay import open_pictures
from patchnet.operators.pipeline.run import run_job
from patchnet.operators.pipeline.unfinished import STAND_IN
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.image.unfinished import Unfinished
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender.job_scene import SMALL, build
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot


@pytest.mark.parametrize("color", [False, True])
def test_pictures_come_before_the_result(weights: Path, monkeypatch: pytest.MonkeyPatch, color: bool) -> None:
    """In their order, those of each step before what takes long: the preview before codes, refinement as it goes."""
    monkeypatch.setattr(views, "_SHOWN_S", -1.0)
    build()
    before = scene_snapshot()
    seen: list[Unfinished | str] = []
    settings = JobSettings.of(max_samples=2, weights=weights, color=color, refined_samples=1024.0, **SMALL)
    steps = run_job(bpy.context, settings, seen.append)
    result = drain(steps, lambda report: seen.append(report.label))
    shown = [item for item in seen if isinstance(item, Unfinished)]
    titles = [item.title for item in shown]
    assert titles[:4] == [STAND_IN, "preview", "preview", "heatmap"]
    assert titles[4:] and all(title.startswith("refining, ") for title in titles[4:])
    assert {item.camera for item in shown} == {"Eye"}
    baking, encoding = (
        next(at for at, item in enumerate(seen) if str(item).startswith(text)) for text in ("Baking", "Encoding")
    )
    assert seen.index(shown[0]) < baking < seen.index(shown[1]) < encoding
    (view,) = result.views
    np.testing.assert_allclose(shown[1].picture, view.pictures["preview"], atol=1e-6)
    np.testing.assert_array_equal(shown[3].picture, view.pictures["priority"])
    assert all(item.picture.shape == view.pictures["preview"].shape for item in shown)
    stand_in, lit = (item.picture.mean(axis=-1) > 0 for item in shown[:2])
    assert (stand_in == lit).mean() > 0.9 and not np.allclose(shown[0].picture, shown[1].picture)
    assert_unchanged(before)


def test_two_lights_need_no_stand_in_and_nobody_looking_no_pictures(weights: Path) -> None:
    build()
    seen: list[Unfinished] = []
    settings = JobSettings.of(light="two-lights", weights=weights, **SMALL)
    result = drain(run_job(bpy.context, settings, seen.append))
    assert all(item.title != STAND_IN for item in seen) and seen[0].title == "preview"
    alone = drain(run_job(bpy.context, settings))
    assert "first look" in result.report["timings_s"] and "first look" not in alone.report["timings_s"]
    np.testing.assert_array_equal(alone.views[0].refined.luminance, result.views[0].refined.luminance)
    with overlay.unfinished_pictures(bpy.context) as meanwhile:
        assert meanwhile is None, "in background"


def test_pictures_of_a_job_go_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As beside a window: they change nothing in the file."""
    build()
    before = scene_snapshot()
    beside_a_window = SimpleNamespace(app=SimpleNamespace(background=False), data=bpy.data, types=bpy.types)
    monkeypatch.setattr(open_pictures, "bpy", beside_a_window)
    with overlay.unfinished_pictures(bpy.context) as meanwhile:
        assert meanwhile is not None
        meanwhile(Unfinished("Eye", "preview", np.zeros((24, 16, 3))))
    assert_unchanged(before)
