# SPDX-License-Identifier: GPL-3.0-or-later
"""Lit sides of sheets by measured light."""

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.sheet_sides import lit_sides


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
