# SPDX-License-Identifier: GPL-3.0-or-later
"""Prediction by the luminance mixture, tile by tile (methods 11.1); `predict.py` calls it."""

from __future__ import annotations

import numpy as np

from ..network.compiled_layers import TILE
from ..network.compiled_mixture import (
    CORNER_CODES,
    COVERED,
    ENTRY,
    decode_mixture_tile,
    empty_luminances,
    empty_mixture_tile,
)
from ..network.kinds import CODE_SIZE, CORNERS
from ..network.lanes import HALF_SCALE, load_halves
from ..runtime.kernels import device, kernel
from ..runtime.vectors import store
from .corner_rows import corner_row
from .mixture_inputs import write_nearby
from .pixel_tiles import fill_codes, fill_rays, gather_look_ahead

_SCALE = np.float32(HALF_SCALE)


@kernel
def predict_mixture(first, last, rays, corner_codes, nearby, layers, coverage, luminance, look_ahead):  # type: ignore[no-untyped-def]
    """Write coverage and luminance of the pixels with look-ahead in runs of TILE pixels, and which these are.

    rays: `PixelRays`. corner_codes: `CornerCodes`. nearby: `NearbyLuminance`. layers: of `pack_mixture`.
    """
    tile, luminances = (empty_mixture_tile(), empty_mixture_tile()), empty_luminances()
    pixels, rows = np.empty(TILE, np.int64), np.empty(TILE, np.int64)
    pixel, end = first * TILE, min(last * TILE, len(coverage))
    while pixel < end:
        count, pixel = gather_look_ahead(rays.node, corner_codes, pixel, end, pixels, rows, look_ahead)
        if count == 0:
            break
        fill_codes(corner_codes, rows[:count], rays.entry, pixels, tile[0])
        fill_rays(rays, pixels[:count], tile[0])
        _fill_corners(corner_codes, rows[:count], tile[0])
        _fill_place(rays, nearby, pixels, rows[:count], tile[0], luminances)
        decode_mixture_tile(tile[0], tile[1], luminances, layers)
        for place in range(count):
            coverage[pixels[place]] = tile[0][place]
            luminance[pixels[place]] = tile[0][TILE + place]


@device
def _fill_corners(corner_codes, rows, inputs):  # type: ignore[no-untyped-def]
    """Write the eight corner codes of pixels side by side; rows: of the nodes they hit."""
    code = np.empty(16, np.float32)
    for place in range(len(rows)):
        for corner in range(CORNERS):
            first = corner_row(corner_codes.rows, rows[place], corner) * CODE_SIZE
            store(code, 0, load_halves(corner_codes.halves, first, first + CODE_SIZE - 8))
            at = (CORNER_CODES + CODE_SIZE * corner) * TILE + place
            for k in range(CODE_SIZE):
                inputs[at + k * TILE] = code[k if k < 8 else k + 16 - CODE_SIZE] * _SCALE


@device
def _fill_place(rays, nearby, pixels, rows, inputs, luminances):  # type: ignore[no-untyped-def]
    """Write entry points, coverage of the children, and what is mixed."""
    for place in range(len(rows)):
        pixel = pixels[place]
        for axis in range(3):
            inputs[(ENTRY + axis) * TILE + place] = np.float32(2) * rays.entry[pixel, axis] - np.float32(1)
        covered = inputs[COVERED * TILE :]
        write_nearby(nearby, rays.node[pixel], rows[place], rays.direction[pixel], covered, luminances, place, TILE)
