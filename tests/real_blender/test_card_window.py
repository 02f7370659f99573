# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewports by the graphics card in a real Blender with a window; card_window.py is what happened there.

    PATCHNET_TURN_S=600 .venv/bin/python -m pytest tests/real_blender/test_card_window.py -k turn

turns the view for ten minutes with each of Blender's graphics libraries instead of a moment.
"""

import os
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

TURN_S = float(os.environ.get("PATCHNET_TURN_S", 10))


@pytest.fixture(scope="module", params=["opengl", "vulkan"])
def seen(request: pytest.FixtureRequest, installed: Blender, yard: Path, out: Path) -> dict:
    """Report of card_window.py, with each of Blender's graphics libraries that is there."""
    name = f"card-{request.param}"
    found = installed.visit(
        name, out, name, str(TURN_S), file=yard, script="card", backend=request.param, screen=(1300, 700),
        seconds=1500.0 + TURN_S,
    )  # fmt: skip
    if request.param.upper() not in found["card"]:
        pytest.skip(f"no {request.param} here, but {found['card']}")
    return found


def test_the_card_shows_what_renders_have(seen: dict) -> None:
    share, mean = seen["differences"]
    assert share < 0.002 and mean < 1e-3 and not seen["by the CPU"]


def test_viewports_share_an_octree_on_the_card(seen: dict) -> None:
    assert seen["octrees on the card"] == 1 and seen["turning frames/s"] > 0.1  # in software


def test_pixels_of_live_heatmaps_are_inspected(seen: dict) -> None:
    (lines,) = seen["inspected"]
    assert [line.partition(" ")[0] for line in lines[:3]] == ["Pixel", "Priority", "Coverage"]


def test_priority_is_that_of_the_estimator(seen: dict) -> None:
    assert set(seen["priority by"]) == {"patchnet-plus-0"}


def test_memory_does_not_grow_while_the_views_turn_and_are_saved(seen: dict) -> None:
    """After the first minute, or the first half of less than two; with Vulkan, Blender itself grows, in Solid, too."""
    turned = seen["turned"]
    taken = [taken for spent, taken in turned["memory"] if spent >= min(60.0, TURN_S / 2)]
    assert turned["frames"] > 1 and turned["saves"] > 0
    assert max(taken) - taken[0] < 64 << 20


def test_workspaces_keep_the_octree_and_another_file_frees_it(seen: dict) -> None:
    assert seen["octrees after workspaces"] == 1 and seen["octrees after another file"] == 0


def test_priority_is_refined_by_the_cpu_at_rest(seen: dict) -> None:
    assert seen["refined by the CPU"] > 1


def test_rays_end_on_the_surface_at_rest_where_the_card_has_no_room(seen: dict) -> None:
    assert seen["exact by the CPU"]


def test_nothing_is_said_of_errors(seen: dict) -> None:
    assert "Error" not in seen["said"] and "GPU" not in seen["said"]
