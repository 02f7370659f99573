# SPDX-License-Identifier: GPL-3.0-or-later
"""Real spherical harmonics against scipy's complex ones."""

import numpy as np
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
