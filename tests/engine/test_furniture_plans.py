# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans of rooms and gardens: same seed, same plan; nothing intersects; things stand where they belong."""

import math
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from patchnet.commands.lab.furnished import kinds
from patchnet.commands.lab.furnished.floor_plan import Box, FloorPlan, Placement, beside
from patchnet.commands.lab.furnished.kinds import Stock, kind_of
from patchnet.commands.lab.furnished.library import TEST, TRAIN, Library, Piece, read_library
from patchnet.commands.lab.furnished.plans import HEAD, credits_text, plan_garden, plan_interior
from patchnet.tests.furniture_library import write_library


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return read_library(write_library(tmp_path / "cubes.sh3f"))


def interior(library: Library, seed: int) -> FloorPlan:
    choice, layout = np.random.default_rng(seed).spawn(2)
    return plan_interior(Stock([library], choice), layout).plan


def garden(library: Library, seed: int) -> FloorPlan:
    choice, layout = np.random.default_rng(seed).spawn(2)
    return plan_garden(Stock([library], choice), layout)


@pytest.mark.parametrize("planned", [interior, garden])
@pytest.mark.parametrize("seed", range(8))
def test_nothing_intersects(library: Library, planned, seed: int) -> None:
    plan = planned(library, seed)
    boxes = [placement.box() for placement in plan.placements]
    assert len(boxes) > 10
    assert all(plan.bounds().holds(box) for box in boxes)
    assert not [pair for pair in combinations(boxes, 2) if pair[0].meets(pair[1])]
    assert not [(box, free) for box in boxes for free in plan.kept_free if box.meets(free)]


@pytest.mark.parametrize("planned", [interior, garden])
def test_seeds(library: Library, planned) -> None:
    assert planned(library, 3) == planned(library, 3) != planned(library, 4)


def test_all_stand_on_something(library: Library) -> None:
    for seed in range(8):
        plan = interior(library, seed)
        below = [placement.box() for placement in plan.placements]
        for placement in plan.placements:
            box = placement.box()
            kind = kind_of(placement.piece) or placement.piece.model
            if kind == kinds.HANGING_LAMP:
                assert box.high[2] == pytest.approx(plan.height)
            elif kind == kinds.SMALL:
                assert any(
                    other.high[2] == pytest.approx(box.low[2])
                    and Box((*other.low[:2], 0.0), (*other.high[:2], 9.0)).holds(box)
                    for other in below
                )
            else:
                assert box.low[2] == 0.0


def test_kinds(library: Library) -> None:
    wanted = [
        kinds.TABLE, kinds.CHAIR, kinds.SOFA, kinds.SHELF, kinds.FLOOR_LAMP, kinds.SMALL, kinds.SMALL, kinds.PLANT,
        kinds.TREE, kinds.SITTING, kinds.STANDING,
    ]  # fmt: skip
    assert [kind_of(piece) for piece in library.pieces] == wanted
    table = library.pieces[0]
    assert kind_of(replace(table, is_opening=True)) is None
    assert kind_of(replace(table, category="Vehicles")) is None
    assert kind_of(replace(table, elevation=1.0)) is None


def test_training_has_nothing_of_our_own(library: Library) -> None:
    tables = tuple(piece for piece in library.pieces if piece.name == "Table")
    for role, own in ((TRAIN, False), (TEST, True)):
        plan = interior(replace(library, role=role, pieces=tables), 1)
        assert any(placement.piece.library is None for placement in plan.placements) == own


def test_boxes_that_touch_do_not_meet() -> None:
    box = Box((0, 0, 0), (1, 1, 1))
    assert not box.meets(Box((1, 0, 0), (2, 1, 1))) and not box.meets(Box((0, 0, 1), (1, 1, 2)))
    assert box.meets(Box((0.9, 0.9, 0.9), (2, 2, 2))) and box.meets(Box((0.2, 0.2, -1), (0.3, 0.3, 5)))
    assert box.holds(Box((0, 0.1, 0), (1, 1, 1))) and not box.holds(Box((0, 0, 0), (1, 1.1, 1)))


def front(placement: Placement) -> np.ndarray:
    return np.array([math.sin(placement.angle), -math.cos(placement.angle)])


@pytest.mark.parametrize("wall", range(4))
def test_fronts(wall: int) -> None:
    """A piece at a wall has its back to it; those beside it face it."""
    piece = Piece("p", "", "", "m", (1.0, 0.5, 1.0))
    plan = FloorPlan(6.0, 4.0, 2.5)
    placed = plan.at_wall(piece, wall, 0.3)
    ahead = np.array(placed.at[:2]) + front(placed)
    assert plan.bounds().holds(placed.box())
    behind = np.array(placed.at[:2]) - front(placed) * 0.3
    assert (np.abs(behind) > (3.0, 2.0)).any() and (np.abs(ahead) < (3.0, 2.0)).all()
    for side in range(4):
        other = beside(placed, piece, side)
        towards = np.array(placed.at[:2]) - other.at[:2]
        assert np.allclose(front(other), towards / np.linalg.norm(towards))
        assert not other.box().meets(placed.box())
        assert not np.allclose(np.linalg.norm(towards), 0)
    assert np.allclose(np.array(beside(placed, piece, 0).at[:2]) - placed.at[:2], front(placed) * 0.52)


def test_credits(library: Library) -> None:
    chair = Placement(library.pieces[1], (0.0, 0.0, 0.0))
    text = credits_text("patchnet lab furnish cubes.sh3f", TEST, [library], [chair, chair], "walls")
    assert text.startswith(HEAD) and "testing only" in text and "Built by the script: walls." in text
    assert text.count("| Chair | A / tester | CC © test | cubes/cube2.obj |") == 1
