# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of overlay_window.py: the screen shows the pictures."""

from pathlib import Path

import numpy as np
import pytest

from patchnet.tests.real_blender.executable import SCREEN, Blender


@pytest.fixture(scope="module")
def seen(installed: Blender, out: Path) -> dict:
    """Report of overlay_window.py."""
    return installed.visit("overlay", out, screen=SCREEN)


@pytest.mark.parametrize("where", ["viewport", "doubled", "image", "render result", "unfinished"])
def test_screen_shows_the_pictures(seen: dict, where: str) -> None:
    on_screen, in_picture = np.array(seen[where], int).swapaxes(0, 1)
    assert np.abs(on_screen - in_picture).max() <= 3  # bytes, after two encodings


@pytest.mark.parametrize("why", ["transparent", "hidden"])
def test_the_viewport_shows_through(seen: dict, why: str) -> None:
    """Without opacity, and where Show Overlays is off."""
    on_screen, in_picture = np.array(seen[why], int).swapaxes(0, 1)
    assert (np.abs(on_screen - in_picture).max(axis=1) > 10).all()


def test_pixel_under_the_mouse(seen: dict) -> None:
    (lines,) = seen["inspected"]
    assert lines[0] == "Pixel 14, 17"
    words = [line.split()[0] for line in lines]
    numbers = ["Priority", "Coverage", "Preview", "Predicted", "Refined", "Reference", "Level", "Samples"]
    assert words == ["Pixel", *numbers]
    assert seen["inspection ended"]


def test_pictures_come_up_in_free_editors_only(seen: dict) -> None:
    assert seen["kept"] == "Painting" and seen["opened"] == "PatchNet Eye heatmap"
    assert seen["windows"] == 1 and seen["in new window"] == ["PatchNet Eye heatmap"]


def test_unfinished_pictures_open_no_window(seen: dict) -> None:
    assert seen["unfinished windows"] == 0


def test_nothing_is_left(seen: dict) -> None:
    assert seen["stale"] == "the camera changed"
    assert seen["drawing"] == [True, ""]
    assert seen["cleared"] == [0, False]


def test_nothing_is_left_by_a_disabled_extension(seen: dict) -> None:
    assert seen["disabled"] == {"drawn": True, "kept": [False, None, None], "modal": []}
    assert seen["enabled"] == ["", True]
