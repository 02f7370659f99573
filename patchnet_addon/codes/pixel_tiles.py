# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiles of pixels for the decoder: codes and rays of hits, a feature a row (`network/compiled_layers.py`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..network.compiled_layers import DIRECTION, RATIO, TILE, UP
from ..network.kinds import CODE_SIZE
from ..runtime.kernels import device
from .corner_codes import MEAN_SIZE, write_mean_code


class PixelRays(NamedTuple):
    """Rays of pixels, as the network is given them; see `Hits`."""

    node: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray


@device
def fill_codes(corner_codes, rows, entry, pixels, inputs):  # type: ignore[no-untyped-def]
    """Write the codes of pixels, interpolated at their entry points, into a tile; rows: of the nodes they hit."""
    halves, table = corner_codes.halves, corner_codes.rows
    mean = np.empty(MEAN_SIZE, np.float32)
    for place in range(len(rows)):
        pixel = pixels[place]
        point = entry[pixel, 0], entry[pixel, 1], entry[pixel, 2]
        write_mean_code(halves, table, rows[place], point, mean)
        for k in range(CODE_SIZE):
            inputs[k * TILE + place] = mean[k if k < 8 else k + MEAN_SIZE - CODE_SIZE]


@device
def fill_rays(rays, pixels, inputs):  # type: ignore[no-untyped-def]
    """Write what the network is given of the rays of pixels into a tile."""
    direction, up, ratio = rays.direction, rays.up, rays.ratio
    for place in range(len(pixels)):
        pixel = pixels[place]
        for axis in range(3):
            inputs[(DIRECTION + axis) * TILE + place] = direction[pixel, axis]
            inputs[(UP + axis) * TILE + place] = up[pixel, axis]
        inputs[RATIO * TILE + place] = ratio[pixel]
