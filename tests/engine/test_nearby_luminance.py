# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells that a luminance mixture mixes: ray frames, cells around corners, and what pixels see of them."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.corner_cells import cell_luminance_table, corner_cells, corner_cells_reference
from patchnet.patchnet_addon.codes.footprint import ABSENT, OUTER_CELLS, footprint_reference
from patchnet.patchnet_addon.codes.ray_frame import FRAMES, cell_order, ray_frames
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.tests.engine.octree_samples import random_octree


@pytest.fixture(scope="module", params=[False, True])
def octree(request) -> Octree:
    return random_octree(seed=3, depth=5, count=900, adaptive=request.param)


def test_corner_cells_are_numpys(octree: Octree) -> None:
    corners = np.random.default_rng(0).integers(0, 9, (400, 3)).astype(np.int32)
    found, wanted = corner_cells(octree, 3, corners), corner_cells_reference(octree, 3, corners)
    assert (wanted > 0).any() and (wanted == 0).any()
    np.testing.assert_array_equal(found, wanted)


def test_a_byte_keeps_luminance_to_four_thousandths() -> None:
    table = cell_luminance_table()
    assert table[0] == -1 and table[1] == 0 and table[255] == 1
    assert (np.diff(table[1:]) > 0).all() and np.diff(table[1:]).max() < 0.008
    assert np.diff(table[1:30]).max() < 0.001  # dark ones more exactly


def test_ray_frames_are_those_of_the_48_symmetries() -> None:
    """In its frame a ray goes up all axes, most along the first, and near cells have lower numbers than far ones."""
    directions = np.random.default_rng(1).normal(size=(4000, 3)).astype(np.float32)
    number, axes, signs = ray_frames(directions)
    assert len(np.unique(number)) == FRAMES
    turned = signs * np.take_along_axis(directions, axes, 1)
    assert (turned >= 0).all() and (np.diff(turned, axis=1) <= 0).all()
    cells = np.stack([np.arange(64) // 4**k % 4 for k in range(3)], axis=-1)
    for frame in range(FRAMES):
        one = np.flatnonzero(number == frame)[0]
        order = cell_order()[frame]
        assert sorted(order) == list(range(64))
        moved = signs[one] * (cells - 1.5)[:, axes[one]] + 1.5
        np.testing.assert_array_equal(moved @ [1, 4, 16], order)


def _look_down(fine: np.ndarray, outer: np.ndarray, entry: list[float], ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Coverage and luminances of a pixel that looks along the first axis of its frame, up along the second."""
    direction, up = np.array([[1, 0, 0]], np.float32), np.array([[0, 1, 0]], np.float32)
    where = np.array([entry], np.float32)
    _, covered, light = footprint_reference(
        fine[None], outer[None], where, direction, up, np.array([ratio], np.float32)
    )
    return covered[0], light[0]


def test_a_full_voxel_covers_the_pixel_by_its_near_children() -> None:
    fine, outer = np.full(64, 0.5, np.float32), np.full(56, ABSENT, np.float32)
    covered, light = _look_down(fine, outer, [0, 0.5, 0.5], 1.0)
    np.testing.assert_allclose(covered[:8:2], 0.25, atol=1e-5)  # each near child a quarter; the far ones alone as much
    np.testing.assert_allclose(covered[1:8:2], 0.25, atol=1e-5)
    np.testing.assert_allclose(light[:8], 0.5, atol=1e-6)
    assert not covered[8:].any() and not light[8:].any()


def test_a_pixel_in_a_corner_sees_one_child_and_cells_beside_it() -> None:
    """A pixel of half the voxel's side about a corner of its face: a quarter lies on the voxel, the rest around it."""
    fine, outer = np.full(64, ABSENT, np.float32), np.full(56, ABSENT, np.float32)
    fine[0] = 0.25  # the cell next to the corner
    beside = [n for n, cell in enumerate(OUTER_CELLS) if cell % 4 == 1 and cell // 4 % 4 == 0 and cell // 16 == 1]
    outer[beside] = 0.75
    covered, light = _look_down(fine, outer, [0, 0, 0], 0.5)
    assert covered[0] == pytest.approx(0.25) and light[0] == pytest.approx(0.25)
    assert covered[8 + beside[0]] == pytest.approx(0.25) and light[8 + beside[0]] == pytest.approx(0.75)
    assert np.count_nonzero(covered) == 2


def test_near_grandchildren_hide_far_ones() -> None:
    fine, outer = np.full(64, ABSENT, np.float32), np.full(56, ABSENT, np.float32)
    fine[[0, 1]] = 0.2, 0.9
    assert _look_down(fine, outer, [0, 0.5, 0.5], 1.0)[1][0] == pytest.approx(0.2)
    fine[0] = ABSENT
    assert _look_down(fine, outer, [0, 0.5, 0.5], 1.0)[1][0] == pytest.approx(0.9)
