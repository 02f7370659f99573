# SPDX-License-Identifier: GPL-3.0-or-later
"""Texel lookup in a texture pyramid at points and squares; functions that kernels call."""

from __future__ import annotations

import math

from ..runtime.kernels import device
from .textures import CLIP, EXTEND, MIRROR


@device
def wrapped(index, size, extension):  # type: ignore[no-untyped-def]
    """Texel index by the texture's extension; -1 outside of a clipped one."""
    if 0 <= index < size:
        return index
    if extension == EXTEND:
        return min(max(index, 0), size - 1)
    if extension == CLIP:
        return -1
    if extension == MIRROR:
        index = index % (2 * size)
        return index if index < size else 2 * size - 1 - index
    return index % size


@device
def bilinear(texels, offset, height, width, extension, u, v):  # type: ignore[no-untyped-def]
    """Opacity * luminance, and opacity, at (u, v) in units of the texture."""
    x = u * width - 0.5
    y = v * height - 0.5
    left = math.floor(x)
    low = math.floor(y)
    fx = x - left
    fy = y - low
    shine = 0.0
    opacity = 0.0
    for dy in range(2):
        row = wrapped(int(low) + dy, height, extension)
        weight_y = fy if dy else 1.0 - fy
        for dx in range(2):
            column = wrapped(int(left) + dx, width, extension)
            if row < 0 or column < 0:
                continue
            weight = weight_y * (fx if dx else 1.0 - fx)
            place = offset + row * width + column
            shine += weight * texels[place, 0]
            opacity += weight * texels[place, 1]
    return shine, opacity


@device
def cut(shine, opacity, threshold):  # type: ignore[no-untyped-def]
    """Cut the opacity of the finest level, which keeps it uncut; NaN for no threshold."""
    if math.isnan(threshold):
        return shine, opacity
    if opacity >= threshold and opacity > 0.0:
        return shine / opacity, 1.0
    return 0.0, 0.0


@device
def opacity_range(texels, offset, height, width, extension, x_first, x_last, y_first, y_last):  # type: ignore[no-untyped-def]
    """Least and greatest opacity of the texels (x_first..x_last, y_first..y_last) of one level."""
    least = math.inf
    most = -math.inf
    for y in range(y_first, y_last + 1):
        row = wrapped(y, height, extension)
        for x in range(x_first, x_last + 1):
            column = wrapped(x, width, extension)
            value = 0.0
            if row >= 0 and column >= 0:
                value = float(texels[offset + row * width + column, 1])
            least = min(least, value)
            most = max(most, value)
    return least, most
