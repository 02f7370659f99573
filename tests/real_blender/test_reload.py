# SPDX-License-Identifier: GPL-3.0-or-later
"""Octrees that survive: what reload_window.py saw, in a Blender that died and in the next one that opens the file."""

import json
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import SMALL_SCREEN, Blender

BAKED = "Baking light"


@pytest.fixture(scope="module")
def visits(installed: Blender, courtyard: Path, out: Path) -> tuple[dict, dict]:
    """Reports from before Blender died, and after the file was opened."""
    script = Path(__file__).with_name("reload_window.py")
    keeping = Blender(installed.prefix, installed.program, installed.environment | {"PATCHNET_KEEP": "1"})
    seen = []
    for name, file in (("made", courtyard), ("opened", out / "reload.blend")):
        done = keeping.run_window(file, "-P", script, "--", out, name, screen=SMALL_SCREEN)
        said = done.stdout + done.stderr
        (out / f"{name}.log").write_text(said)
        assert (out / f"{name}.json").exists(), f"see {out / name}.log"
        seen.append(json.loads((out / f"{name}.json").read_text()) | {"said": said})
    return seen[0], seen[1]


def test_visits_came_to_their_ends(visits: tuple[dict, dict]) -> None:
    died, opened = visits
    assert died["problem"] == "stopped after made" and BAKED in died["steps"]
    assert opened["problem"] == "" and "Traceback" not in opened["said"]


def test_voxels_and_codes_come_back_and_fit(visits: tuple[dict, dict]) -> None:
    died, opened = visits
    assert died["told"]["codes"] > 1000 and died["told"]["stale"] == []
    assert opened["told"] == opened["told when reverted"] == died["told"]


def test_pictures_come_back_with_render_preview(visits: tuple[dict, dict]) -> None:
    _, opened = visits
    assert opened["pictures at first"] == [] and opened["pictures"] == 11
    assert opened["steps of the preview"] and BAKED not in opened["steps of the preview"]


def test_renders_take_them_without_a_bake(visits: tuple[dict, dict]) -> None:
    _, opened = visits
    assert opened["render"] == {"ended": ["complete"], "same voxels": True}
