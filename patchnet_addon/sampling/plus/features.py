# SPDX-License-Identifier: GPL-3.0-or-later
"""Features of pixels and their estimate in NumPy: the reference for the compiled estimator (methods 12.1, 12.2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .forms import CENTRE, FLOOR, NORMALS, Form, Kind, Plane

LOWEST, HIGHEST = -12.0, 8.0  # of the variance's logarithm


def windows_of(planes: np.ndarray) -> np.ndarray:
    """Windows (C, 9, n * w) float32 of the pixels within planes (C, n + 2, w + 2) with their border."""
    count, height, width = planes.shape
    places = [(row, column) for row in range(3) for column in range(3)]
    parts = [planes[:, row : row + height - 2, column : column + width - 2] for row, column in places]
    return np.stack(parts, axis=1).reshape(count, 9, -1)


def features_of(
    windows: np.ndarray, form: Form, planes: Sequence[Plane] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Features (F, N) float32 of windows (C, 9, N) of `planes`, and the squared scale (N,) float32.

    The scale is the root mean square of the pixel's luminance differences. They are divided by it, so that features do
    not depend on contrast. planes: those of the form unless they are given.
    """
    planes = form.planes if planes is None else planes
    there = {plane: windows[number] for number, plane in enumerate(planes)}
    here = {plane: window[CENTRE] for plane, window in there.items()}
    values = np.empty((len(form.features), windows.shape[2]), np.float32)
    scale = np.full(windows.shape[2], FLOOR, np.float32)
    for row, feature in zip(values, form.features, strict=True):
        value = there[feature.plane][feature.place]
        if feature.kind == Kind.DIFFERENCE:
            np.subtract(value, here[form.shown], out=row)
            scale += np.float32(feature.share) * row**2
        elif feature.kind == Kind.SLOPE:
            slope = (value - here[Plane.DEPTH]) * here[Plane.PER_PIXEL]
            np.divide(slope, 1 + np.abs(slope), out=row)
        elif feature.kind == Kind.ANGLE:
            row[:] = sum(there[normal][feature.place] * here[normal] for normal in NORMALS)
        else:
            row[:] = value
    differences = [feature.kind == Kind.DIFFERENCE for feature in form.features]
    first, last = differences.index(True), len(differences) - differences[::-1].index(True)
    values[first:last] /= np.sqrt(scale)
    np.log(scale, out=values[-1])
    return values, scale
