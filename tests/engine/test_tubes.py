# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of tubes and spheres are closed, face outwards, and have the projected width of round ones."""

import numpy as np
import pytest

from patchnet.patchnet_addon.light.sheets import sheets_of
from patchnet.patchnet_addon.surface.tubes import sphere_triangles, spheres, tube_triangles, tubes


def volume_and_area(corners: np.ndarray) -> tuple[float, float]:
    """Volume that triangles (T, 3, 3) enclose, negative where they face inwards, and their area."""
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float((corners[:, 0] * doubled).sum() / 6.0), float(np.linalg.norm(doubled, axis=1).sum() / 2.0)


@pytest.mark.parametrize("sides", [3, 5, 7])
def test_tubes(sides: int) -> None:
    """Strands of 2, 5 and 9 points, the last one a hook whose tip has no width."""
    turn = np.linspace(0.0, np.pi, 9)
    hook = np.stack([np.cos(turn), np.sin(turn), 0.1 * turn], axis=1)
    points = np.concatenate([[(0, 0, 0), (0, 0, 5)], np.linspace((2, 0, 0), (4, 3, 1), 5), hook]).astype(np.float32)
    radii = np.full(len(points), 0.05, np.float32)
    radii[-1] = 0.0
    first = np.array([0, 2, 7, 16])
    made = tubes(points, radii, first, sides)
    assert len(made.triangles) == tube_triangles(16, 3, sides)
    sheet, is_open = sheets_of(made.vertices, made.triangles)
    assert not is_open.any() and len(is_open) == 3 and (sheet < 0).sum() <= 2 * sides, "the tip has no area"
    distances = np.linalg.norm(made.vertices - points[made.points], axis=1)
    np.testing.assert_allclose(distances, radii[made.points] * np.pi / (sides * np.sin(np.pi / sides)), rtol=1e-4)
    straight = made.triangles[(made.points[made.triangles] < 2).all(axis=1)]
    volume, area = volume_and_area(made.vertices[straight].astype(np.float64))
    ends = 2.0 * volume / 5.0
    assert volume > 0.0 and area - ends == pytest.approx(2.0 * np.pi * 0.05 * 5.0, rel=1e-4)


@pytest.mark.parametrize("divisions", [0, 1, 2])
def test_spheres(divisions: int) -> None:
    points = np.array([(0, 0, 0), (3, 1, 2)], np.float32)
    made = spheres(points, np.array([1.0, 0.5], np.float32), divisions)
    assert len(made.triangles) == sphere_triangles(2, divisions)
    assert sheets_of(made.vertices, made.triangles)[1].tolist() == [False, False]
    volume, area = volume_and_area(made.vertices[made.triangles].astype(np.float64))
    assert volume > 0.0 and area == pytest.approx(4.0 * np.pi * 1.25, rel=1e-4)
    outwards = made.vertices[made.triangles] - points[made.points[made.triangles]]
    np.testing.assert_allclose(
        made.normals, outwards / np.linalg.norm(outwards, axis=2, keepdims=True), atol=1e-5, err_msg="of a sphere"
    )
