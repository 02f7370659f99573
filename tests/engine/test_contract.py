# SPDX-License-Identifier: GPL-3.0-or-later
"""The level-of-detail contract in kernels against its plain twins, and by its definition (methods 4.1b)."""

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.contract import (
    MAX_LEVELS,
    fits_pixel,
    fitting_level,
    fitting_level_of,
    has_lookahead,
    pixel_voxel_ratio,
)
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.lookups import fits_pixel_of
from patchnet.tests.references.small import pixel_voxel_ratio_reference


@kernel
def levels_of(sides, levels):
    for row in range(len(sides)):
        levels[row] = fitting_level(sides[row])


@kernel
def fits_and_ratios(sides, level, fits, ratios):
    for row in range(len(sides)):
        fits[row] = fits_pixel(0.5**level, sides[row])
        ratios[row] = pixel_voxel_ratio(sides[row], 2.0**level)


@kernel
def lookaheads(child_mask, first_child, lookahead, found):
    for node in range(len(found)):
        found[node] = has_lookahead(child_mask, first_child, node, lookahead)


def compiled_levels(sides):
    levels = np.empty(len(sides), np.int64)
    levels_of(np.asarray(sides, np.float64), levels)
    return levels


SIDES = np.concatenate([2.0 ** -np.arange(0, 20), np.exp(np.random.default_rng(0).uniform(-13, 1, 500))])


def test_first_level_that_fits():
    """Powers of two are on the edge: a voxel of just two pixels does not stop a ray."""
    levels = compiled_levels(SIDES)
    np.testing.assert_array_equal(levels, fitting_level_of(SIDES))
    assert fits_pixel_of(0.5**levels, SIDES).all()
    assert not fits_pixel_of(0.5 ** (levels - 1.0), SIDES)[levels > 0].any()
    np.testing.assert_array_equal(compiled_levels([0.25, 0.26, 0.0]), [2, 1, MAX_LEVELS])


def test_kernels_and_twins():
    fits, ratios = np.empty(len(SIDES), bool), np.empty(len(SIDES))
    for level in range(12):
        fits_and_ratios(SIDES, level, fits, ratios)
        np.testing.assert_array_equal(fits, fits_pixel_of(0.5**level, SIDES))
        np.testing.assert_array_equal(ratios, pixel_voxel_ratio_reference(SIDES, 2.0**level))


def test_ratios_of_voxels_that_fit_are_what_the_network_knows():
    """Unless the parent, too, would have fitted, they need no clamp."""
    levels = fitting_level_of(SIDES)[20:]
    inner = levels > 0
    ratio = SIDES[20:] * 2.0**levels
    np.testing.assert_array_equal(pixel_voxel_ratio_reference(SIDES[20:], 2.0**levels)[inner], ratio[inner])
    assert ((ratio[inner] > 0.5) & (ratio[inner] <= 1.0)).all()


@pytest.mark.parametrize("adaptive", [False, True])
@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_lookahead_of_single_nodes(adaptive, lookahead):
    octree = random_octree(seed=2, depth=5, count=300, adaptive=adaptive)
    found = np.empty(octree.node_count, bool)
    lookaheads(octree.child_mask, octree.first_child, lookahead, found)
    np.testing.assert_array_equal(found, octree.look_ahead(lookahead))
