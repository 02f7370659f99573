# SPDX-License-Identifier: GPL-3.0-or-later
"""Texel sizes follow the leaf levels of an octree."""

import numpy as np

from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.lightmap.texel_sizes import texel_sizes
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.surface.mesh import TriangleMesh

GRID = Grid((0.0, 0.0, 0.0), 8.0, 9)


def halves(left: int, right: int) -> LeafLevels:
    """Blocks of level 3, one unit wide; leaves of level `left` where x < 4, of level `right` elsewhere."""
    cells = np.argwhere(np.ones((8, 8, 8), bool))
    levels = np.zeros(512, np.uint8)
    levels[morton_encode(cells).astype(np.int64)] = np.where(cells[:, 0] < 4, left, right)
    return LeafLevels(levels)


def sizes(corners: np.ndarray, layout: LeafLevels) -> np.ndarray:
    return texel_sizes(TriangleMesh.from_arrays(corners), GRID, layout, 2.0)


def small(place: tuple[float, float, float]) -> np.ndarray:
    return np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]) + np.array(place)


def test_small_triangles_have_the_leaves_around_them() -> None:
    result = sizes(np.stack([small((1.2, 3.3, 5.5)), small((6.2, 3.3, 5.5))]), halves(9, 6))
    np.testing.assert_allclose(result, [2 * 8 / 2**9, 2 * 8 / 2**6], rtol=1e-6)


def test_large_triangles_get_as_many_texels_as_their_parts_would() -> None:
    ground = np.array([[[0, 0, 1.0], [8, 0, 1.0], [0, 8, 1.0]], [[8, 8, 1.0], [0, 8, 1.0], [8, 0, 1.0]]])
    result = sizes(ground, halves(7, 4))
    fine, coarse = (2 * 8 / 2**7) ** 2, (2 * 8 / 2**4) ** 2
    # The first triangle has three quarters of its area on the left, the second one quarter.
    for side, left in zip(result, (0.75, 0.25), strict=True):
        wanted = left / fine + (1 - left) / coarse
        assert abs(1 / side**2 / wanted - 1) < 0.08  # some of the points' triangles cross the border


def test_places_without_leaves_and_outside_have_blocks() -> None:
    result = sizes(np.stack([small((1.2, 3.3, 5.5)), small((6.2, 3.3, 5.5)), small((9.0, 3.3, 5.5))]), halves(0, 5))
    np.testing.assert_allclose(result, [2.0, 2 * 8 / 2**5, 2 * 8 / 2**5], rtol=1e-6)
