# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples per pixel in jobs, operators, panels, presets, overlay, commands, renders and viewports."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.properties import scene_settings
from patchnet.operators.render_engine import panels as engine_panels
from patchnet.operators.session import results
from patchnet.operators.settings.groups import ViewSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.ui.main import PATCHNET_PT_statistics
from patchnet.operators.ui.preview import PATCHNET_PT_compare, PATCHNET_PT_preview
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.runtime.quantities import error_text
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.tests.blender.drawn import drawn
from patchnet.tests.blender.engine_scene import build_for_engine, camera, kept, rendered
from patchnet.tests.blender.job_scene import SMALL, view_of

pytestmark = pytest.mark.usefixtures("registered")

SIZE = (48, 32)


@pytest.mark.parametrize("color", [False, True])
def test_a_job_traces_the_samples_that_it_says(scene: bpy.types.Scene, color: bool) -> None:
    found = view_of(scene, ViewSettings(size=SIZE, spp=6.0), color=color)
    buffers, refined, report = found.buffers, found.refined, found.report["refined"]
    active = buffers.active
    assert report["spp"] == 6.0 and 5.9 < report["spent"] <= 6.0
    assert report["spent"] == pytest.approx(refined.samples[active].mean())
    assert report["pixels"] == {str(n): int((refined.samples[active] == n).sum()) for n in (1, 4, 16, 64, 256, 1024)}
    for side in (2, 4):
        pixels = np.flatnonzero(refined.samples == side**2)
        means = supersample_pixels(found.octree, found.camera, pixels, side)
        assert len(pixels) > 3
        np.testing.assert_array_equal(refined.luminance[pixels], means.luminance)
        assert not np.array_equal(means.luminance, buffers.reference[pixels]), "traced, not taken from the reference"
        if color:
            np.testing.assert_array_equal(refined.colors[pixels], means.colors)
    error = (refined.luminance.astype(float) - buffers.reference)[active] ** 2
    assert found.errors == (found.report["mse_unrefined"], report["mse"])
    assert report["mse"] == pytest.approx(error.mean()) and report["mse"] < found.report["mse_unrefined"]
    other = view_of(scene, ViewSettings(size=SIZE, refined_samples=1024.0), color=color)
    assert "spp" not in other.report["refined"] and other.report["mse"] == found.report["mse"], (
        "strategies compare by their share"
    )
    assert other.errors[1] == pytest.approx(other.report["mse"][DEFAULT])
    for name in ("preview", "priority", "reference"):
        np.testing.assert_array_equal(other.pictures[name], found.pictures[name])
    for name in ("order", "refined", "error"):
        assert not np.array_equal(other.pictures[name], found.pictures[name]), name


def test_panel_and_figures(scene: bpy.types.Scene, capfd: pytest.CaptureFixture[str]) -> None:
    assert bpy.ops.patchnet.run_all(light="two-lights", reference=True, **SMALL) == {"FINISHED"}
    by_share = results.voxels_of(scene).errors
    scene.patchnet.spp = 4.0
    assert "'Pixel Samples' changed: render again" in drawn(PATCHNET_PT_preview)
    assert "spp" in drawn(PATCHNET_PT_preview)
    assert not {"budget", "spp"} & set(drawn(engine_panels.PATCHNET_PT_render_refinement))
    scene.patchnet.render_samples = 0.0
    assert {"budget", "spp"} <= set(drawn(engine_panels.PATCHNET_PT_render_refinement))
    assert bpy.ops.patchnet.render_preview(size=SMALL["size"], reference=True) == {"FINISHED"}
    assert "after refining with 4 samples per pixel" in capfd.readouterr().out
    result = results.voxels_of(scene)
    assert result.errors[0] == by_share[0] and result.errors[1] != by_share[1]
    errors = "Error x 10,000: {}, refined {}".format(*map(error_text, result.errors))
    assert errors in "\n".join(drawn(PATCHNET_PT_statistics))
    assert bpy.ops.patchnet.compare(size=SMALL["size"]) == {"FINISHED"}
    assert "Eye, 24 x 16: squared error x 10,000, budget 30%" in drawn(PATCHNET_PT_compare)
    assert bpy.ops.patchnet.render_preview(size=SMALL["size"], reference=True, spp=0.0) == {"FINISHED"}, "0 is again"
    assert results.voxels_of(scene).errors == by_share


def test_settings_and_what_is_wrong_with_them(scene: bpy.types.Scene) -> None:
    assert scene_settings(scene).view.spp is None and JobSettings().view.spp is None
    scene.patchnet.spp = 7.5
    assert scene_settings(scene).view.spp == 7.5
    assert scene_settings(scene).view.budget_text == "7.5 samples per pixel"
    assert ViewSettings(budget=0.25).budget_text == "a budget of 25%"
    scene.patchnet.spp = 5000.0
    assert scene.patchnet.spp == 1024.0
    scene.patchnet.spp = 0.5
    with pytest.raises(RuntimeError, match=r"Samples per pixel 0.5 is outside 1 to 1024: give the mean"):
        bpy.ops.patchnet.run_all(light="two-lights", **SMALL)


@pytest.mark.parametrize("mean", [6.0, 1024.0])
def test_render_and_its_sample_count(weights: Path, tmp_path: Path, mean: float) -> None:
    scene = build_for_engine(weights, tmp_path)
    scene.patchnet.spp = mean
    found = rendered(scene)
    chosen = [STRATEGIES[scene.patchnet.strategy], STRATEGIES["patchnet"]]
    buffers = drain(trace_view(kept(scene).octree, camera(), chosen, coded=kept(scene).coded))
    samples = rank(chosen[0], buffers, 0.3).samples(mean)
    np.testing.assert_array_equal(found["Sample Count"][..., 0], buffers.picture(samples))
    assert samples[buffers.active].mean() <= mean
    if mean == 1024.0:
        assert set(samples.tolist()) == {1, 1024}
