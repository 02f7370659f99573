# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the reports of cycles_window.py: Refine with Cycles in a responsive window."""

from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

RENDERS = 4  # the pixel with which Cycles reads the scene, the region, the whole picture, the reference


def visit(part: str, blender: Blender, out: Path) -> dict:
    """Report of cycles_window.py."""
    found = blender.visit(f"cycles-{part}", out, part, script="cycles", simulate=part == "button")
    assert found["left in the folder for temporary files"] == []
    return found


@pytest.fixture(scope="module")
def button(installed: Blender, out: Path) -> dict:
    """The button, pressed."""
    return visit("button", installed, out)


@pytest.fixture(scope="module")
def escape(installed: Blender, out: Path) -> dict:
    """A run that was stopped, between two that were not."""
    return visit("escape", installed, out)


def test_the_button_renders_beside_the_window(button: dict) -> None:
    assert button["button"]["ended"] == ["complete"] * RENDERS
    assert button["button"]["ticks"] >= RENDERS and button["button"]["draws"] >= RENDERS
    assert button["changed"] == [] and button["in overlay"]


def test_a_script_that_waits_gets_the_same_bits(button: dict) -> None:
    assert button["script"] == ["FINISHED"]
    assert set(button["same pixels"].values()) == {True}


def test_the_window_lives_until_escape_stops_the_whole_picture(escape: dict) -> None:
    """The visit has waited until the window was drawn often and progress had moved, and only then pressed Esc."""
    assert escape["whole"]["running"] == "Refine with Cycles" and escape["whole"]["ended"] == []
    assert escape["stopped"] == {"ended": ["cancel"], "job": False, "renders": 3}
    assert escape["changed"] == []


def test_the_next_run_is_as_the_one_before(escape: dict) -> None:
    assert escape["again"] == {"ended": ["complete"] * RENDERS, "same pixels": True}
