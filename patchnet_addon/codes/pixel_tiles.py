# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiles of pixels for the decoder: codes and rays of hits, a feature a row (`network/compiled_layers.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..network.compiled_layers import DIRECTION, RATIO, TILE, UP
from ..network.kinds import CODE_SIZE
from ..runtime.kernels import device
from .coded_nodes import coded_row
from .corner_codes import MEAN_SIZE, write_mean_code

if TYPE_CHECKING:
    from ..tracing.render import Hits


class PixelRays(NamedTuple):
    """Rays of pixels, as the network is given them; see `Hits`."""

    node: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray

    @classmethod
    def of(cls, hits: Hits) -> PixelRays:
        """Rays of all pixels of a view, as kernels take them."""
        floats = (hits.entry_voxel, hits.direction, hits.up, hits.ratio)
        return cls(
            np.ascontiguousarray(hits.node, np.int64), *(np.ascontiguousarray(array, np.float32) for array in floats)
        )

    def part(self, pixels: np.ndarray) -> PixelRays:
        """Rays of some of the pixels."""
        return PixelRays(*(array[pixels] for array in self))


@device
def gather_look_ahead(nodes, corner_codes, pixel, end, pixels, rows, look_ahead):  # type: ignore[no-untyped-def]
    """Gather pixels from `pixel` on whose nodes have codes, as many as a tile has room for, and their rows.

    pixels, rows: (TILE,) int64, written. look_ahead: (P,) bool, set for them. Returns how many there are, and the pixel
    to go on with.
    """
    bits, before = corner_codes.bits, corner_codes.before
    count = 0
    while pixel < end and count < TILE:
        row = coded_row(bits, before, nodes[pixel])
        if row >= 0:
            look_ahead[pixel] = True
            pixels[count], rows[count] = pixel, row
            count += 1
        pixel += 1
    return count, pixel


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
