# SPDX-License-Identifier: GPL-3.0-or-later
"""Harmonics equal scipy's complex ones, which are orthonormal, combined by the definition."""

import numpy as np
import pytest
from scipy.special import sph_harm_y

from patchnet.patchnet_addon.network.harmonics import real_harmonics


def _real_from_complex(degree, order, polar, azimuth):
    value = np.sqrt(2) * (-1.0) ** order * sph_harm_y(degree, abs(order), polar, azimuth)
    return value.imag if order < 0 else value.real if order > 0 else value.real / np.sqrt(2)


def test_equal_to_scipy():
    directions = np.random.default_rng(1).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    values = real_harmonics(directions)
    for degree in range(5):
        for order in range(-degree, degree + 1):
            wanted = _real_from_complex(degree, order, polar, azimuth)
            np.testing.assert_allclose(values[:, degree**2 + degree + order], wanted, atol=1e-12)


@pytest.mark.parametrize("degree", range(5))
def test_lower_degrees_are_a_prefix(degree):
    directions = np.eye(3, dtype=np.float32)
    values = real_harmonics(directions, degree)
    assert values.shape == (3, (degree + 1) ** 2)
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values, real_harmonics(directions)[:, : values.shape[1]])


def test_degree_outside_the_table():
    with pytest.raises(ValueError, match="Degree 5"):
        real_harmonics(np.eye(3), 5)
