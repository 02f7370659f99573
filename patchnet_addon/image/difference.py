# SPDX-License-Identifier: GPL-3.0-or-later
"""Signed differences of two pictures in diverging colours, and pictures side by side.

All arrays are (H, W), linear luminance, row 0 at the bottom; results (h, w, 3) sRGB-encoded.
"""

from __future__ import annotations

import numpy as np

from ..runtime.errors import SettingError
from .colormaps import diverging
from .heatmap import magnify, with_legend
from .tone import gray


def difference_picture(difference: np.ndarray, maximum: float, title: str, quantity: str) -> np.ndarray:
    """Blue where `difference` is negative, red where it is positive, pale where it is 0; legend to +-`maximum`."""
    return with_legend([_signed(difference, maximum)], [title], _ramp, _ticks(maximum), quantity)


def side_by_side(
    reference: np.ndarray, picture: np.ndarray, maximum: float, titles: tuple[str, str, str]
) -> np.ndarray:
    """Reference, the picture, and how much brighter the picture is, with the legend of the difference."""
    views = [magnify(gray(reference)), magnify(gray(picture)), _signed(picture - reference, maximum)]
    return with_legend(views, list(titles), _ramp, _ticks(maximum), "luminance, octree less Cycles")


def _signed(difference: np.ndarray, maximum: float) -> np.ndarray:
    if not (np.isfinite(maximum) and maximum > 0):
        raise SettingError(f"The difference's maximum {maximum} must be a positive number")
    return magnify(diverging(difference / np.float32(maximum)))


def _ramp(position: np.ndarray) -> np.ndarray:
    return diverging(2.0 * position - 1.0)


def _ticks(maximum: float) -> list[str]:
    return [f"{maximum * share:.3g}" for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
