# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the reports of reload_window.py: octrees survive a killed Blender."""

from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

BAKED = "Baking light"


@pytest.fixture(scope="module")
def visits(installed: Blender, yard: Path, out: Path) -> tuple[dict, dict]:
    """Reports from before Blender died, and after the file was opened."""
    keeping = Blender(installed.prefix, installed.program, installed.environment | {"PATCHNET_KEEP": "1"})
    died = keeping.visit("made", out, "made", file=yard, script="reload", ended="stopped after made")
    assert BAKED in died["steps"]
    return died, keeping.visit("opened", out, "opened", file=out / "reload.blend", script="reload")


def test_voxels_and_codes_come_back_and_fit(visits: tuple[dict, dict]) -> None:
    died, opened = visits
    assert died["told"]["codes"] > 100 and died["told"]["stale"] == []
    assert opened["told"] == opened["told when reverted"] == died["told"]


def test_pictures_come_back_with_render_preview(visits: tuple[dict, dict]) -> None:
    _, opened = visits
    assert opened["pictures at first"] == [] and opened["pictures"] == 11
    assert opened["steps of the preview"] and BAKED not in opened["steps of the preview"]


def test_renders_take_them_without_a_bake(visits: tuple[dict, dict]) -> None:
    _, opened = visits
    assert opened["render"] == {"ended": ["complete"], "same voxels": True}
