# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of tab_window.py: the tab with simulated mouse and keys."""

from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import SCREEN, Blender

IMAGES = {f"PatchNet Far {name}" for name in ("preview", "heatmap", "overlay", "refined", "priority", "coverage")}
STEPS = ("voxelize", "bake_light", "precompute_codes", "render_preview", "run_all")


@pytest.fixture(scope="module")
def visit(installed: Blender, yard: Path, out: Path) -> dict:
    """Report of tab_window.py."""
    return installed.visit("tab", out, file=yard, screen=SCREEN)


def test_tab_has_all_buttons(visit: dict) -> None:
    assert visit["tab"] == "PatchNet"
    assert {f"patchnet.{name}" for name in STEPS} <= set(visit["buttons"])


def test_buttons_that_come_too_early_change_nothing(visit: dict) -> None:
    """They are gray; and nothing is selected, which is a sentence."""
    assert visit["bake before voxels"] == visit["voxelize nothing"] == {"running": "", "result": False}


def test_escape_stops_and_leaves_no_trace(visit: dict) -> None:
    stopped = visit["stopped bake"]
    assert stopped["was_running"] == "Bake Light"
    assert stopped["light"] == "none" and stopped["unchanged"]


def test_steps_do_their_work(visit: dict) -> None:
    assert visit["octree"]["depth"] == 6 and visit["octree"]["voxels"] > 1000
    assert visit["light"] == "cycles" and visit["codes"] > 100
    assert set(visit["pictures"]) >= IMAGES


def test_scene_is_as_before(visit: dict) -> None:
    assert visit["unchanged by steps"]
    assert visit["stale after own work"] == []


def test_changes_are_noticed_and_undone_and_redone(visit: dict) -> None:
    assert visit["stale"] == [[], ["surface"], [], ["surface"]]
    assert visit["why"].endswith("changed") and visit["undone"]


def test_run_all_writes_its_files(visit: dict) -> None:
    assert {"report.json", "octree.safetensors", "codes.safetensors", "Far/heatmap.png"} <= set(visit["files"])


def test_memory_is_given_back(visit: dict) -> None:
    assert visit["freed"]
