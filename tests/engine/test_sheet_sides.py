# SPDX-License-Identifier: GPL-3.0-or-later
"""Which sides of sheets get light, and where that is measured."""

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.sheet_sides import MOST_SHEETS, asked_sheets, lit_sides, points_on_sheets


@pytest.mark.parametrize(
    ("front", "back", "lit"),
    [
        (1.0, 1.0, 0),
        (0.1, 1.0, 0),  # ceiling of a dim room, the sun on its top
        (1.0, 0.021, 0),
        (1.0, 0.019, 1),  # a building's wall, dark inside
        (0.019, 1.0, -1),  # the same, with normals into the building
        (0.0, 1.0, -1),
        (0.0, 1e-4, 1),  # dark on both sides
        (0.0, 0.0, 1),
    ],
)
def test_one_sheet_among_others_in_light(front: float, back: float, lit: int) -> None:
    light = np.array([(1.0, 0.8), (front, back), (1.2, 0.0)])
    assert lit_sides(light, np.array([4.0, 1.0, 4.0])).tolist() == [0, lit, 1]


def test_a_front_as_bright_as_others_is_lit_whatever_falls_on_its_back() -> None:
    light = np.array([(0.01, 1.0), (0.012, 1.0), (0.011, 0.9)])
    assert lit_sides(light, np.ones(3)).tolist() == [0, 0, 0]
    light[1, 0] = 1e-4
    assert lit_sides(light, np.ones(3)).tolist() == [0, -1, 0]


def test_large_sheets_are_asked() -> None:
    assert asked_sheets(np.array([5.0, 1.0, 0.0, 9.0, 2.0])).tolist() == [3, 0, 4, 1]
    assert len(asked_sheets(np.ones(2 * MOST_SHEETS))) == MOST_SHEETS


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
