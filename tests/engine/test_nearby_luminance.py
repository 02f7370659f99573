# SPDX-License-Identifier: GPL-3.0-or-later
"""Luminance along the axes and around corners: kernels against NumPy, and against what one sees of a voxel."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.axis_luminance import (
    axis_coverage_table,
    axis_luminance,
    axis_luminance_reference,
    seen_along,
)
from patchnet.patchnet_addon.codes.corner_luminance import corner_luminance, corner_luminance_reference
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.tests.engine.octree_samples import random_octree


@pytest.fixture(scope="module", params=[False, True])
def octree(request) -> Octree:
    return random_octree(seed=3, depth=5, count=900, adaptive=request.param)


def test_axis_luminance_is_numpys(octree: Octree) -> None:
    wanted = axis_luminance_reference(octree)
    assert len(wanted) == octree.level_start[octree.depth]
    np.testing.assert_allclose(axis_luminance(octree), wanted, atol=0.5)


def test_corner_luminance_is_numpys(octree: Octree) -> None:
    corners = np.random.default_rng(0).integers(0, 9, (400, 3)).astype(np.int32)
    wanted = corner_luminance_reference(octree, 3, corners)
    assert (wanted > 0).any() and (wanted == 0).any()
    np.testing.assert_allclose(corner_luminance(octree, 3, corners), wanted, atol=0.5)


def test_coverage_along_axes_counts_columns() -> None:
    table = axis_coverage_table()
    assert table.shape == (256, 6) and (table[0] == 1).all() and (table[255] == 1).all()
    np.testing.assert_array_equal(table[0b00000001], 0.25)
    np.testing.assert_array_equal(table[0b00000011], [0.25, 0.25, 0.5, 0.5, 0.5, 0.5])  # two beside each other along x
    np.testing.assert_array_equal(table[0b00001111], [0.5, 0.5, 0.5, 0.5, 1, 1])  # a plate across z


def test_front_and_back_of_a_plate_differ() -> None:
    """A child that is dark below and bright above: from above one sees the bright, from the side both."""
    coverage, luminance = np.zeros((1, 8, 6), np.float32), np.zeros((1, 8, 6), np.float32)
    coverage[0, 5] = 1
    luminance[0, 5] = [0.5, 0.5, 0.5, 0.5, 0.1, 0.9]
    for direction, wanted in (((0, 0, -1), 0.9), ((0, 0, 1), 0.1), ((1, 0, 0), 0.5), ((0, -0.6, -0.8), 0.756)):
        covered, light = seen_along(coverage, luminance, np.array([direction], np.float32))
        assert covered[0].tolist() == pytest.approx([0, 0, 0, 0, 0, 1, 0, 0])
        assert light[0, 5] == pytest.approx(wanted)
