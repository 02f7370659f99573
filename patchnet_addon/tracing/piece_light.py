# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of a piece where a ray meets it: that of the side it meets, times the base colour there (methods 7.2k)."""

from __future__ import annotations

import math

import numpy as np

from ..cells.hashing import mixed
from ..octree.pieces import EXPONENT_BIAS, HOLES, MANTISSA, TRIANGLE
from ..runtime.kernels import device
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.hit_lookup import base_at_hit, is_clear
from .tile import PICTURE, PIECE, WEIGHTS


@device
def see_piece(pieces, tile, ray, pixel):
    """Luminance, red, green and blue of the piece that a ray meets, linear; a negative luminance where it has a hole.

    pixel: side of the ray's footprint. Of partial opacity, rays meet as large a share.
    """
    number = np.int64(tile.numbers[PIECE, ray])
    index, side = number >> 1, number & 1
    word = np.int64(pieces.triangle[index])
    row = word & np.int64(TRIANGLE)
    one, two = tile.numbers[WEIGHTS, ray], tile.numbers[WEIGHTS + 1, ray]
    if word & np.int64(HOLES) and is_clear(pieces.textures, pieces.uvs, row, side):
        return -1.0, 0.0, 0.0, 0.0
    red, green, blue, opacity = base_at_hit(pieces.textures, pieces.uvs, row, one, two, pixel)
    if word & np.int64(HOLES) and opacity < 1.0 and opacity <= _drawn(tile.numbers, ray, index):
        return -1.0, 0.0, 0.0, 0.0
    packed = np.int64(pieces.light[index, side])
    scale = math.ldexp(1.0 / MANTISSA, int(packed >> 27) - EXPONENT_BIAS)
    red *= scale * (packed & 511)
    green *= scale * (packed >> 9 & 511)
    blue *= scale * (packed >> 18 & 511)
    return RED * red + GREEN * green + BLUE * blue, red, green, blue


@device
def _drawn(numbers, ray, index):
    """Number in [0, 1) of a ray and a piece."""
    x, y = np.int64(numbers[PICTURE, ray] * 2.0**30), np.int64(numbers[PICTURE + 1, ray] * 2.0**30)
    return (mixed(mixed(np.uint64(x), y), index) >> np.uint64(11)) * 2.0**-53
