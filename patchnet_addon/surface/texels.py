# SPDX-License-Identifier: GPL-3.0-or-later
"""Texel lookup in a mip chain at points and squares; device functions for kernels."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..runtime.kernels import device
from .textures import BLACK, EXTEND, MIRROR, REPEAT

_FAR = 2.0**24

# Numbers only: each use of a tuple counts references of its arrays, which costs more than a lookup.


class MipChain(NamedTuple):
    """Mip chain of one texture: its levels from `first` on, finest first; wrap: of `WRAP_MODES`."""

    first: int
    level_count: int
    wrap: int


class MipLevel(NamedTuple):
    """Level of a mip chain: `height` rows of `width` texels, from `offset` on among all texels."""

    offset: int
    height: int
    width: int
    wrap: int


@device
def on_texture(m, s, r):
    """Transform UV coordinates (s, r) onto a texture with m (2, 3), clamped to `_FAR`.

    Larger coordinates are whole numbers in single precision, which all wrap modes treat like `_FAR`.
    """
    return _on_axis(m, 0, s, r), _on_axis(m, 1, s, r)


@device
def _on_axis(m, axis, s, r):
    """One coordinate of `on_texture`."""
    coordinate = m[axis, 0] * s + m[axis, 1] * r + m[axis, 2]
    if -_FAR < coordinate < _FAR:
        return coordinate
    return _FAR if coordinate > 0.0 else -_FAR


@device
def wrapped(index, size, wrap):
    """Texel index by the texture's wrap mode; -1 outside of one that ends at its border."""
    if 0 <= index < size:
        return index
    if wrap == EXTEND:
        return min(max(index, 0), size - 1)
    if wrap == MIRROR:
        index = index % (2 * size)
        return index if index < size else 2 * size - 1 - index
    return index % size if wrap == REPEAT else -1


@device
def mip_level(levels, chain, step):
    """Level `step` of a chain, 0 the finest, of all levels (V, 3) as `MipChains` holds them."""
    at = chain.first + step
    return MipLevel(levels[at, 0], levels[at, 1], levels[at, 2], chain.wrap)


@device
def texels_around(level, u, v):
    """Indices of the four texels around (u, v), -1 beyond a border, and their bilinear weights."""
    x, y = u * level.width - 0.5, v * level.height - 0.5
    left, low = math.floor(x), math.floor(y)
    x, y = x - left, y - low
    west = wrapped(int(left), level.width, level.wrap)
    east = wrapped(int(left) + 1, level.width, level.wrap)
    south = _row(wrapped(int(low), level.height, level.wrap), level)
    north = _row(wrapped(int(low) + 1, level.height, level.wrap), level)
    texels = _texel(south, west), _texel(south, east), _texel(north, west), _texel(north, east)
    return texels, ((1.0 - y) * (1.0 - x), (1.0 - y) * x, y * (1.0 - x), y * x)


@device
def _row(row, level):
    """Index of the first texel of a row, -1 for none."""
    return level.offset + row * level.width if row >= 0 else -1


@device
def _texel(first, column):
    """Index of a texel in a row, -1 for none."""
    return first + column if first >= 0 and column >= 0 else -1


@device
def bilinear(texels, level, u, v):
    """Opacity * luminance, and opacity, at (u, v) in units of the texture."""
    premultiplied = opacity = 0.0
    around, weights = texels_around(level, u, v)
    for corner in range(4):
        texel, weight = around[corner], weights[corner]
        if texel >= 0:
            premultiplied += weight * texels[texel, 0]
            opacity += weight * texels[texel, 1]
        elif level.wrap == BLACK:
            opacity += weight
    return premultiplied, opacity


@device
def cut(premultiplied, opacity, threshold):
    """Cut the opacity of the finest level, which keeps it uncut; NaN for no threshold."""
    if math.isnan(threshold):
        return premultiplied, opacity
    if opacity >= threshold and opacity > 0.0:
        return premultiplied / opacity, 1.0
    return 0.0, 0.0


@device
def opacity_range(texels, level, x_first, x_last, y_first, y_last):
    """Least and greatest opacity of the texels (x_first..x_last, y_first..y_last) of one level."""
    least = math.inf
    most = -math.inf
    for y in range(y_first, y_last + 1):
        row = wrapped(y, level.height, level.wrap)
        for x in range(x_first, x_last + 1):
            column = wrapped(x, level.width, level.wrap)
            value = 0.0
            if row >= 0 and column >= 0:
                value = float(texels[level.offset + row * level.width + column, 1])
            least = min(least, value)
            most = max(most, value)
    return least, most
