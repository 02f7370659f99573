# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells that a luminance mixture mixes: ray frames, cells around corners, and what pixels see of them."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.corner_cells import corner_cells
from patchnet.patchnet_addon.codes.footprint import ABSENT
from patchnet.patchnet_addon.codes.outer_cells import mask_geometry
from patchnet.patchnet_addon.codes.ray_frame import FRAMES, cell_order
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.tests.engine.octree_samples import random_octree, with_sides
from patchnet.tests.references.codes import (
    corner_cells_reference,
    face_luminances_reference,
    footprint_reference,
    outer_cells_reference,
    packed_reference,
)
from patchnet.tests.references.lookups import face_luminances, ray_frames


@pytest.fixture(scope="module", params=[False, True])
def octree(request) -> Octree:
    octree = random_octree(seed=3, depth=5, count=900, adaptive=request.param)
    return with_sides(octree) if request.param else octree


def test_corner_cells_are_numpys(octree: Octree) -> None:
    corners = np.random.default_rng(0).integers(0, 9, (400, 3)).astype(np.int32)
    found, wanted = corner_cells(octree, 3, corners), corner_cells_reference(octree, 3, corners)
    assert (wanted > 0).any() and (wanted == 0).any()
    np.testing.assert_array_equal(found, wanted)


def test_a_word_keeps_the_luminances_of_faces() -> None:
    """To 0.008 where all faces are alike, and to 0.04 however different they are along one axis."""
    random = np.random.default_rng(2)
    alike = np.repeat(random.random((500, 1)), 6, axis=1)
    np.testing.assert_allclose(face_luminances(packed_reference(np.full(500, 255), alike)), alike, atol=0.008)
    roots = np.full((500, 6), 0.5) + random.uniform(-0.5, 0.5, (500, 1)) * np.array([0, 0, -1, 1, 0, 0])
    words = packed_reference(np.full(500, 255), roots**2)
    np.testing.assert_allclose(face_luminances(words), roots**2, atol=0.07)
    assert np.abs(face_luminances(words) - roots**2).mean() < 0.01
    dark = np.repeat(random.uniform(0, 0.01, (500, 1)), 6, axis=1)
    np.testing.assert_allclose(face_luminances(packed_reference(np.full(500, 255), dark)), dark, atol=0.0005)


def test_a_face_shows_the_children_that_are_met_first() -> None:
    lights = np.full((1, 8), -1.0)
    lights[0, [0, 1, 2]] = 0.2, 0.6, 0.4  # two behind each other along x, and one beside them
    faces = face_luminances_reference(lights)[0]
    np.testing.assert_allclose(faces, [0.3, 0.5, 0.4, 0.5, 0.4, 0.4])
    halves_and_columns = int(mask_geometry()[0b111])
    assert halves_and_columns & 63 == 0b011111  # both halves along x and y, the lower one along z
    assert [halves_and_columns >> (6 + 3 * axis) & 7 for axis in range(3)] == [2, 2, 3]


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


def _look_down(fine: np.ndarray, entry: list[float], ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Coverage and luminances of the children of a pixel that looks along the first axis, up along the second."""
    direction, up = np.array([[1, 0, 0]], np.float32), np.array([[0, 1, 0]], np.float32)
    where = np.array([entry], np.float32)
    _, covered, light = footprint_reference(fine[None], where, direction, up, np.array([ratio], np.float32))
    return covered[0], light[0]


def test_a_full_voxel_covers_the_pixel_by_its_near_children() -> None:
    covered, light = _look_down(np.full(64, 0.5, np.float32), [0, 0.5, 0.5], 1.0)
    np.testing.assert_allclose(covered, 0.25, atol=1e-5)  # each near child a quarter; the far ones alone as much
    np.testing.assert_allclose(light, 0.5, atol=1e-6)


def _word(mask: int, faces: list[float]) -> int:
    return int(packed_reference(np.array([mask]), np.array([faces]))[0])


def test_a_pixel_in_a_corner_sees_one_child_and_cells_beside_it() -> None:
    """A pixel of half the voxel's side about a corner of its face: a quarter lies on the voxel, the rest around it."""
    fine = np.full(64, ABSENT, np.float32)
    fine[0] = 0.25  # the cell next to the corner
    covered, light = _look_down(fine, [0, 0, 0], 0.5)
    assert covered[0] == pytest.approx(0.25) and light[0] == pytest.approx(0.25) and not covered[1:].any()

    words = np.zeros((1, 64), np.int64)
    below = 8 * 0 + 0b101  # at corner 0, behind its plane along x, below along y, above along z
    words[0, below] = _word(255, [0.75, 0.25, 0.5, 0.5, 0.5, 0.5])
    words[0, 8 * 0 + 7] = words[0, below]  # lies in the voxel itself
    one = np.array([[0, 0, 0]]), np.array([[1, 0, 0]]), np.array([[0, 1, 0]]), np.array([0.5])
    covered, light = outer_cells_reference(words, *one)
    assert covered[0, below] == pytest.approx(0.25, abs=1e-4)
    assert light[0, below] == pytest.approx(0.75, abs=0.05)  # the face that the ray meets
    assert np.count_nonzero(covered) == 1


@pytest.mark.parametrize(("mask", "share"), [(0b10010110, 1.0), (0b01010101, 0.5), (0b00010001, 0.25)])
def test_a_cell_covers_as_much_as_the_columns_of_its_children(mask: int, share: float) -> None:
    """A pixel that looks along z at a cell beside its voxel: as full as the columns along z that hold a child."""
    words, cell = np.zeros((1, 64), np.int64), 0b110  # at corner 0, beside the voxel along x
    words[0, cell] = _word(mask, [0.5] * 6)
    entry, ratio = np.array([[-0.25, 0.25, 0]]), np.array([1.0])
    covered, _ = outer_cells_reference(words, entry, np.array([[0, 0, 1]]), np.array([[0, 1, 0]]), ratio)
    assert covered[0, cell] == pytest.approx(0.25 * share, abs=1e-4)


def test_near_grandchildren_hide_far_ones() -> None:
    fine = np.full(64, ABSENT, np.float32)
    fine[[0, 1]] = 0.2, 0.9
    assert _look_down(fine, [0, 0.5, 0.5], 1.0)[1][0] == pytest.approx(0.2)
    fine[0] = ABSENT
    assert _look_down(fine, [0, 0.5, 0.5], 1.0)[1][0] == pytest.approx(0.9)
