# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine in a real Blender with a window; engine_window.py is what happened there."""

import json
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import SMALL_SCREEN, Blender


@pytest.fixture(scope="module")
def seen(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of engine_window.py."""
    script = Path(__file__).with_name("engine_window.py")
    done = installed.run_window(courtyard, "-P", script, "--", out, screen=SMALL_SCREEN)
    (out / "engine.log").write_text(done.stdout + done.stderr)
    report = out / "engine.json"
    assert report.exists(), f"Blender ended with code {done.returncode} before the visit did: see {out / 'engine.log'}"
    found: dict = json.loads(report.read_text())
    assert not found["problem"], found["problem"]
    return found | {"said": done.stdout + done.stderr}


def test_the_viewport_refines_while_it_stands_still(seen: dict) -> None:
    assert seen["coarse at first"]
    assert seen["finest"] == 1024 and 0.0 < seen["refined share"] < 0.005


def test_the_viewport_shows_the_world_behind_objects(seen: dict) -> None:
    """A gradient that is black nowhere."""
    assert seen["sky"]["share"] > 0.01 and seen["sky"]["least"] > 0.0 and seen["sky"]["spread"] > 0.001


def test_a_picture_goes_on_while_the_world_is_looked_at(seen: dict) -> None:
    assert seen["begun anew"] == 0


def test_leaving_the_shading_mode_frees_the_picture(seen: dict) -> None:
    assert seen["references left"] == 3  # the script's list, its variable, and the question itself


def test_f12_renders_beside_the_window(seen: dict) -> None:
    assert "Black is shown behind objects" not in seen["said"]
    assert seen["render"]["ended"] == "complete" and ["IMAGE_EDITOR"] in seen["windows"]


def test_voxels_that_do_not_fit_are_shown_with_a_warning(seen: dict, out: Path) -> None:
    """Above the picture it stays, as the screenshot shows: scripts cannot read it."""
    assert seen["render of old voxels"]["ended"] == "complete"
    assert any("do not fit the scene any more" in text for text in seen["said of old voxels"])
    assert (out / "engine-old.png").stat().st_size > 5000


def test_without_voxels_nothing_breaks(seen: dict, out: Path) -> None:
    """The status bar of that moment is in a screenshot: scripts cannot read it."""
    assert seen["render without voxels"]["ended"] in ("complete", "cancel") and "Traceback" not in seen["said"]
    for name in ("no-voxels", "traced", "refined", "render", "error"):
        assert (out / f"engine-{name}.png").stat().st_size > 5000


def test_viewports_refine_where_masks_are_white(seen: dict) -> None:
    """Looking through the camera, whose picture is in the middle of the view; after strokes the preview starts anew."""
    left, right = seen["mask left"]["columns"], seen["mask right"]["columns"]
    assert 0.1 < left[0] < left[1] < 0.51 and 0.49 < right[0] < right[1] < 0.9


def test_viewports_find_weights_on_what_renders_show(seen: dict) -> None:
    """With a subdivision that is finer in renders than in viewports, where it stays as it was."""
    assert seen["levels before"] == seen["levels after"] == 1
    assert seen["mask group"]["heaviest"] == 1.0 and seen["mask lighter group"]["heaviest"] == 0.5
    assert 0.001 < seen["mask group"]["matter"] == seen["mask lighter group"]["matter"] < 0.2
