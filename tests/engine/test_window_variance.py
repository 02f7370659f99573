# SPDX-License-Identifier: GPL-3.0-or-later
"""Variance of windows by the kernel is NumPy's."""

import numpy as np
import pytest

from patchnet.patchnet_addon.sampling.window_variance import window_variance
from patchnet.tests.references.small import window_variance_reference


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2), (3, 3), (5, 2), (9, 17), (40, 130)])
def test_windows_of_all_sizes(shape: tuple[int, int]) -> None:
    """The order of additions differs, nothing else: 1e-15 of numbers of at most 1."""
    picture = np.random.default_rng(sum(shape)).random(shape, np.float32)
    expected = window_variance_reference(picture)
    np.testing.assert_allclose(window_variance(picture), expected, rtol=1e-12, atol=1e-15)


def test_flat_pictures_have_none() -> None:
    assert not window_variance(np.full((6, 8), 0.7, np.float32)).any()
