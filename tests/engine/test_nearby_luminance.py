# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of a luminance mixture: ray frames and cells around corners against references."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.corner_cells import corner_cells
from patchnet.patchnet_addon.codes.outer_cells import mask_geometry
from patchnet.patchnet_addon.codes.ray_frame import FRAMES, cell_order
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.tests.engine.octree_samples import random_octree, with_sides
from patchnet.tests.references.codes import (
    corner_cells_reference,
    face_luminances_reference,
)
from patchnet.tests.references.lookups import ray_frames


@pytest.fixture(scope="module", params=[False, True])
def octree(request) -> Octree:
    octree = random_octree(seed=3, depth=5, count=900, adaptive=request.param)
    return with_sides(octree) if request.param else octree


def test_corner_cells_are_numpys(octree: Octree) -> None:
    corners = np.random.default_rng(0).integers(0, 9, (400, 3)).astype(np.int32)
    found, wanted = corner_cells(octree, 3, corners), corner_cells_reference(octree, 3, corners)
    assert (wanted > 0).any() and (wanted == 0).any()
    np.testing.assert_array_equal(found, wanted)


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
