# SPDX-License-Identifier: GPL-3.0-or-later
"""Which side of a sheet is shown, by light and cameras, and where the light of it is measured."""

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.sheet_sides import (
    CLEAR,
    MOST_SHEETS,
    asked_sheets,
    points_on_sheets,
    turned_sheets,
)

FRONT, BACK, BOTH, NOBODY = (100, 0), (5, 95), (50, 50), (0, 0)


@pytest.mark.parametrize(
    ("front", "back", "seen", "turned"),
    [
        (0.1, 1.0, BACK, True),  # ground that faces down, under the sun
        (0.1, 1.0, FRONT, False),  # ceiling of a dim room, the sun on its top; lampshade seen from outside
        (0.1, 1.0, BOTH, False),
        (0.1, 1.0, NOBODY, False),
        (0.5, 1.0, BACK, False),  # less than CLEAR
        (1.0, 0.1, BACK, False),  # too bright, not black
        (0.0, 1.0, BACK, True),
        (0.0, 1.0, FRONT, False),  # a black front that is seen is black
        (0.0, 1.0, NOBODY, True),  # enclosed
        (0.019, 1.0, NOBODY, True),
        (0.021, 1.0, NOBODY, False),
        (0.0, 1e-4, BACK, False),  # dark on both sides
    ],
)
def test_one_sheet_among_others_in_light(front: float, back: float, seen: tuple[int, int], turned: bool) -> None:
    light = np.array([(1.0, 0.8), (front, back), (1.2, 0.0)])
    found = turned_sheets(light, np.array([4.0, 1.0, 4.0]), np.array([FRONT, seen, FRONT]))
    assert found.tolist() == [False, turned, False]


def test_a_sunlit_back_turns_no_unseen_sheet_whose_front_is_as_bright_as_others() -> None:
    """A room of sheets under the sun: what nobody looks at just now shows the room, too."""
    light = np.array([(0.01, 1.0), (0.012, 1.0), (0.011, 0.9)])
    assert not turned_sheets(light, np.ones(3), np.zeros((3, 2), int)).any()
    light[1, 0] = 1e-4
    assert turned_sheets(light, np.ones(3), np.zeros((3, 2), int)).tolist() == [False, True, False]


def test_the_threshold_is_of_the_light_that_falls_in_front() -> None:
    light = np.array([(1.0, 0.99 * CLEAR), (1.0, 1.01 * CLEAR)])
    assert turned_sheets(light, np.ones(2), np.array([BACK, BACK])).tolist() == [False, True]


def test_without_light_nothing_turns() -> None:
    assert not turned_sheets(np.zeros((2, 2)), np.ones(2), np.array([BACK, NOBODY])).any()


def test_sheets_seen_from_behind_are_asked_first_then_large_ones() -> None:
    areas = np.array([5.0, 1.0, 0.0, 9.0, 2.0])
    seen = np.array([(9, 0), (0, 3), (0, 8), (0, 0), (1, 1)])
    assert asked_sheets(areas, seen).tolist() == [1, 4, 3, 0]
    assert len(asked_sheets(np.ones(2 * MOST_SHEETS), np.zeros((2 * MOST_SHEETS, 2), int))) == MOST_SHEETS


def test_points_follow_area_and_lie_in_their_triangles() -> None:
    rng = np.random.default_rng(0)
    sheet, areas = rng.integers(-1, 6, 400), rng.random(400) * (rng.random(400) > 0.2)
    asked = np.array([4, 0, 3])
    points = points_on_sheets(asked, sheet, areas)
    assert points.sheet.reshape(3, -1)[:, 0].tolist() == [4, 0, 3] and len(points.sheet) == 3 * 32
    np.testing.assert_array_equal(sheet[points.triangle], points.sheet)
    assert (areas[points.triangle] > 0.0).all()
    assert points.barycentric.min() >= 0.0 and points.barycentric.sum(axis=1).max() <= 1.0
    large = np.array([0, 1, 0, -1]), np.array([6.0, 1.0, 2.0, 50.0])
    found = points_on_sheets(np.array([0, 1]), *large)
    assert np.bincount(found.triangle, minlength=4).tolist() == [24, 32, 8, 0]
    inside = found.barycentric[found.triangle == 1]
    np.testing.assert_allclose(inside.mean(axis=0), 1 / 3, atol=0.05)


def test_no_sheets_have_no_points() -> None:
    assert not len(points_on_sheets(np.empty(0, np.int64), np.array([-1, -1]), np.zeros(2)).triangle)
