# SPDX-License-Identifier: GPL-3.0-or-later
"""Features of pixels and their estimate in NumPy: the reference of the compiled estimator (methods 12.1, 12.2)."""

from __future__ import annotations

import numpy as np

from ..pixel_buffers import PixelBuffers
from .forms import CENTRE, FLOOR, Form, Kind, Plane
from .planes import view_planes
from .weights import Estimators

LOWEST, HIGHEST = -12.0, 8.0  # of the variance's logarithm


def windows_of(planes: np.ndarray) -> np.ndarray:
    """Windows (C, 9, n * w) float32 of the pixels within planes (C, n + 2, w + 2) with their border."""
    count, height, width = planes.shape
    places = [(row, column) for row in range(3) for column in range(3)]
    parts = [planes[:, row : row + height - 2, column : column + width - 2] for row, column in places]
    return np.stack(parts, axis=1).reshape(count, 9, -1)


def features_of(windows: np.ndarray, form: Form) -> tuple[np.ndarray, np.ndarray]:
    """Features (F, N) float32 of windows (C, 9, N) of the form's planes, and the squared scale (N,) float32.

    The scale is the mean size of the differences of luminance that a pixel knows; they are divided by it, so that the
    same pattern looks the same at any contrast.
    """
    index = {plane: number for number, plane in enumerate(form.planes)}
    kind, plane, place = form.table.T
    values = windows[plane, place]  # (F, N)
    here = windows[:, CENTRE]
    differences, slopes, angles = (kind == one for one in (Kind.DIFFERENCE, Kind.SLOPE, Kind.ANGLE))
    values[differences] -= here[index[form.base]]
    scale = np.float32(FLOOR) + form.shares[differences] @ values[differences] ** 2
    values[differences] /= np.sqrt(scale)
    slope = (values[slopes] - here[index[Plane.DEPTH]]) * here[index[Plane.PER_PIXEL]]
    values[slopes] = slope / (1 + np.abs(slope))
    normal = index[Plane.NORMAL_X]
    values[angles] = sum(windows[normal + axis, place[angles]] * here[normal + axis] for axis in range(3))
    values[kind == Kind.SCALE] = np.log(scale)
    return values, scale


def estimate_reference(buffers: PixelBuffers, estimators: Estimators, form: Form) -> np.ndarray:
    """Expected error sqrt(E[e^2]) of every pixel, (P,) float32; reference of `estimate`, which leaves out some."""
    values, scale = features_of(windows_of(view_planes(buffers, form.planes)), form)
    (*hidden, (matrix, bias)), skip = estimators.networks[form.name]
    direct = skip @ values
    for weight, offset in hidden:
        values = np.maximum(weight @ values + offset[:, None], 0)
    variance, mean = matrix @ values + bias[:, None]
    result: np.ndarray = np.sqrt(scale * ((mean + direct) ** 2 + np.exp(np.clip(variance, LOWEST, HIGHEST))))
    return result
