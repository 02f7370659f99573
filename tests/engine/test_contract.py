# SPDX-License-Identifier: GPL-3.0-or-later
"""The level-of-detail contract in kernels against its plain twin, and by its definition (methods 4.1b)."""

import numpy as np

from patchnet.patchnet_addon.cells.contract import MAX_LEVELS, fitting_level, fitting_level_of
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.tests.references.lookups import fits_pixel_of


@kernel
def levels_of(sides, levels):
    for row in range(len(sides)):
        levels[row] = fitting_level(sides[row])


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
