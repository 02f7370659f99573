# SPDX-License-Identifier: GPL-3.0-or-later
"""Corners in the order of codes, rows of voxels, and encoding in one kernel, against references."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.brick import OCTANTS
from patchnet.patchnet_addon.codes.corner_rows import coded_nodes, set_corner_rows
from patchnet.patchnet_addon.codes.corners import corner_ranges, places_of
from patchnet.patchnet_addon.codes.encode import chunk_blocks, encode_corners, make_encoder
from patchnet.patchnet_addon.directional.node_kernels import row_of
from patchnet.patchnet_addon.network.weights import Weights
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.tests.engine.octree_samples import random_octree, with_boxes
from patchnet.tests.references.codes import coded_rows_reference, corners_of
from patchnet.tests.references.networks import NumpyEncoder


@pytest.fixture(scope="module", params=[False, True], ids=["uniform", "adaptive, with boxes"])
def octree(request):
    octree = random_octree(seed=8, depth=6, count=1500, adaptive=request.param)
    return with_boxes(octree) if request.param else octree


def coded_cells(octree, level, lookahead=2):
    nodes = np.flatnonzero(octree.look_ahead(lookahead)[octree.level(level)])
    return octree.cells(level)[nodes], nodes + octree.level_start[level]


def corners_reference(cells):
    """Distinct corners (C, 3) of cells in the order z, y, x, by sorting all of them."""
    every = (cells[:, None] + OCTANTS).reshape(-1, 3)
    return np.unique(every[:, ::-1], axis=0)[:, ::-1]


@kernel
def write_rows(coded, nodes, rows):
    for index in range(len(nodes)):
        rows[index] = row_of(coded, nodes[index])


@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_rows_of_nodes(octree, lookahead):
    coded, count = coded_nodes(octree, lookahead)
    wanted = coded_rows_reference(octree, lookahead)
    assert count == wanted.max() + 1
    nodes = np.concatenate([np.arange(octree.node_count), [-1, 64 * len(coded.bits)]])
    rows = np.empty(len(nodes), np.int64)
    write_rows(coded, nodes, rows)
    np.testing.assert_array_equal(rows, np.concatenate([wanted, [-1, -1]]))


@pytest.mark.parametrize("most", [1, 50, 1 << 15])
def test_ranges_have_all_corners_in_order(octree, most):
    """Ranges of planes, and of single planes that have too many voxels."""
    rows = coded_rows_reference(octree, 2)
    table, total = np.zeros((rows.max() + 1, 3), np.uint32), 0
    found = []
    for level in range(octree.depth - 1):
        parts = list(corner_ranges(octree, np.flatnonzero(rows >= 0), level, total, table, most))
        assert most == 1 << 15 or level < 3 or len(parts) > 1
        found.append(places_of(np.concatenate(parts), level))
        total += len(found[-1])
        np.testing.assert_array_equal(found[-1], corners_reference(coded_cells(octree, level)[0]))
    corners = np.concatenate(found)
    for level in range(octree.depth - 1):
        cells, nodes = coded_cells(octree, level)
        np.testing.assert_array_equal(corners[corners_of(table, rows[nodes])], cells[:, None] + OCTANTS)


def test_a_step_of_more_than_16_bits_is_refused():
    table, line = np.zeros((1, 3), np.uint32), np.zeros(1, np.int64)
    set_corner_rows(table, line, 0, np.array([10]))
    set_corner_rows(table, line, 2, np.array([65545]))
    assert corners_of(table, 0)[2] == 65545
    with pytest.raises(SettingError, match=r"A line of voxels has more corners .*: choose a smaller depth"):
        set_corner_rows(table, line, 2, np.array([65546]))


@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_codes_of_corners(octree, lookahead):
    """The same bits beside any others; in corners that adaptive leaves lie around, too."""
    weights = Weights.random(seed=9, bias=0.1, lookahead=lookahead)
    layers = make_encoder(weights)
    for level in range(octree.depth):
        corners = corners_reference(octree.cells(level))
        corners = corners[:: 1 + len(corners) // 200]
        found = encode_corners(octree, level, corners, layers, lookahead)
        for first in (1, 37):
            others = encode_corners(octree, level, corners[first:], layers, lookahead)
            np.testing.assert_array_equal(others, found[first:])
        wanted = NumpyEncoder(weights)(*chunk_blocks(octree, level, corners, lookahead))
        np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-4)
    assert encode_corners(octree, 3, corners[:0], layers, lookahead).shape == (0, 10)
