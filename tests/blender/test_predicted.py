# SPDX-License-Identifier: GPL-3.0-or-later
"""Predicted pictures as unrefined pixels: in jobs, operators, panels, overlay and renders."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.views import View
from patchnet.operators.properties.job import scene_settings
from patchnet.operators.render_engine import panels as engine_panels
from patchnet.operators.session import results
from patchnet.operators.session.shown_view import view_to_show
from patchnet.operators.settings.groups import ViewSettings
from patchnet.operators.ui.stages import PATCHNET_PT_compare, PATCHNET_PT_preview
from patchnet.operators.ui.tab import stale_text
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.render import seen_above_white
from patchnet.tests.blender.drawn import drawn
from patchnet.tests.blender.engine_scene import WORLD, build_for_engine, kept, rendered
from patchnet.tests.blender.job_scene import SMALL, view_of
from patchnet.tests.blender.objects import active_camera

pytestmark = pytest.mark.usefixtures("registered")

SIZE = (48, 32)
CHOSEN = STRATEGIES[DEFAULT]


def seen(scene: bpy.types.Scene, *, color: bool = False, **wanted: object) -> View:
    """A view of the small scene."""
    return view_of(scene, ViewSettings(size=SIZE, refined_samples=1024.0, **wanted), color=color)


def test_overlay_has_the_predicted_picture_and_its_error(scene: bpy.types.Scene) -> None:
    found = seen(scene)
    shown = view_to_show(found, ViewSettings(size=SIZE), 0.0)
    np.testing.assert_allclose(shown.picture("PREDICTED", 1.0, "viridis"), found.pictures["predicted"], atol=0.51 / 255)
    error, _ = shown.mapped("PREDICTED_ERROR", 1.0)
    np.testing.assert_allclose(error.ravel(), np.abs(found.buffers.predicted - found.buffers.reference), atol=1e-6)
    column, row = np.argwhere(found.buffers.picture(found.buffers.hit))[0][::-1]
    value = found.buffers.picture(found.buffers.predicted)[row, column]
    assert f"Predicted luminance {value:.4f}" in shown.describe_pixel(int(column), int(row), 1.0)


def test_operators_and_panels_have_the_setting(scene: bpy.types.Scene) -> None:
    assert bpy.ops.patchnet.run_all(light="two-lights", unrefined="predicted", **SMALL) == {"FINISHED"}
    assert bpy.data.images["PatchNet Eye predicted"].size[0] == SMALL["size"][0]
    assert bpy.data.images["PatchNet Eye predicted luminance"].is_float
    assert scene.patchnet.unrefined == "preview" == scene_settings(scene).view.unrefined
    for chosen in ("preview", "predicted"):
        scene.patchnet.unrefined = chosen
        assert bpy.ops.patchnet.render_preview(size=SMALL["size"]) == {"FINISHED"}
        result = results.result_of(scene)
        assert not stale_text(result, scene, "view")
    scene.patchnet.unrefined = "preview"
    assert stale_text(result, scene, "view") == "'Unrefined Pixels' changed: render again"
    scene.patchnet.render_samples = 0.0
    for panel in (PATCHNET_PT_preview, engine_panels.PATCHNET_PT_render_refinement):
        assert "unrefined" in drawn(panel)
    assert bpy.ops.patchnet.compare(size=SMALL["size"]) == {"FINISHED"}
    labels = drawn(PATCHNET_PT_compare)
    assert "Preview, unrefined" in labels and "Predicted, unrefined" in labels


@pytest.mark.parametrize("transparent", [False, True])
def test_render_shows_it(weights: Path, tmp_path: Path, transparent: bool) -> None:
    scene = build_for_engine(weights, tmp_path)
    scene.patchnet.unrefined, scene.render.film_transparent = "predicted", transparent
    found = rendered(scene)
    result = kept(scene)
    buffers = drain(trace_view(result.octree, active_camera(), [CHOSEN], coded=result.coded, unrefined="predicted"))
    ranking = rank(CHOSEN, buffers, scene.patchnet.budget)
    np.testing.assert_allclose(found["Priority"][..., 0], buffers.picture(ranking.priority), atol=1e-6)
    left = ~ranking.mask
    pixels = found["Combined"].reshape(-1, 4)[left]
    alpha, light = buffers.shown_alpha[left], buffers.predicted[left] / result.octree.exposure
    assert buffers.prediction is not None
    above = seen_above_white(result.octree, buffers.hits)[left] * buffers.prediction.coverage[left, None]
    world = np.zeros(3) if transparent else np.array(WORLD) * 0.5
    shown = light[:, None] + above / result.octree.exposure + (1 - alpha)[:, None] * world
    np.testing.assert_allclose(pixels[:, :3], shown, atol=1e-5)
    np.testing.assert_allclose(pixels[:, 3], alpha if transparent else 1.0, atol=1e-6)
    assert ((alpha > 0) & (alpha < 1)).any(), "edges are soft before anything is refined"
