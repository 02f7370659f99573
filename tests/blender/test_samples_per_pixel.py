# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples per pixel in operators, panels and settings."""

import bpy
import pytest

from patchnet.operators.properties.job import scene_settings
from patchnet.operators.render_engine import panels as engine_panels
from patchnet.operators.session import results
from patchnet.operators.settings.groups import ViewSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.ui.main import PATCHNET_PT_statistics
from patchnet.operators.ui.stages import PATCHNET_PT_compare, PATCHNET_PT_preview
from patchnet.patchnet_addon.runtime.quantities import error_text
from patchnet.tests.blender.drawn import drawn
from patchnet.tests.blender.job_scene import SMALL

pytestmark = pytest.mark.usefixtures("registered")


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
