# SPDX-License-Identifier: GPL-3.0-or-later
"""Prediction by the luminance mixture, tile by tile (methods 11.1); `predict.py` calls it."""

from __future__ import annotations

import numpy as np

from ..network.compiled_layers import TILE
from ..network.compiled_mixture import decode_mixture_tile, empty_luminances, empty_mixture_tile
from ..network.kinds import CODE_SIZE, CORNERS, COVERING, RAY_INPUTS, SIDE_BY_SIDE
from ..network.mixture_decode import COVERED, VIEWS
from ..network.simd import HALF_SCALE, load_halves
from ..octree.octree import LUMINANCE_SCALE
from ..runtime.kernels import device, kernel, lean_device
from ..runtime.vectors import store
from .corner_rows import corner_row
from .fine_cells import empty_fine_list
from .footprint import clear_tile, empty_footprint_tile, measure_tile
from .mixture_inputs import place_pixel
from .outer_cells import empty_outer_list
from .pixel_tiles import fill_codes, fill_rays, gather_look_ahead

_SCALE = np.float32(HALF_SCALE)


@kernel
def predict_mixture(first, last, rays, corner_codes, nearby, layers, results):  # type: ignore[no-untyped-def]
    """Write coverage and luminance of the pixels with look-ahead in runs of TILE pixels, and which these are.

    rays: `PixelRays`. corner_codes: `CornerCodes`. nearby: `NearbyCells`. layers: of `pack_mixture`.
    results: coverage, luminance, and whether there is look-ahead.
    """
    coverage, luminance, look_ahead = results
    tile, luminances = (empty_mixture_tile(), empty_mixture_tile()), empty_luminances()
    work = empty_footprint_tile(), empty_fine_list(), empty_outer_list()
    pixels, rows = np.empty(TILE, np.int64), np.empty(TILE, np.int64)
    pixel, end = first * TILE, min(last * TILE, len(coverage))
    while pixel < end:
        count, pixel = gather_look_ahead(rays.node, corner_codes, pixel, end, pixels, rows, look_ahead)
        if count == 0:
            break
        fill_codes(corner_codes, rows[:count], rays.entry, pixels, tile[0])
        fill_rays(rays, pixels[:count], tile[0])
        _fill_corners(corner_codes, rows[:count], tile[0])
        _fill_place(rays, nearby, pixels, rows[:count], work, tile[0], luminances)
        decode_mixture_tile(tile[0], tile[1], luminances, layers)
        for place in range(count):
            coverage[pixels[place]] = tile[0][place]
            luminance[pixels[place]] = tile[0][TILE + place]


@device
def _fill_corners(corner_codes, rows, inputs):  # type: ignore[no-untyped-def]
    """Write the first numbers of the eight corner codes of pixels side by side; rows: of the nodes they hit."""
    halves, table = corner_codes.halves, corner_codes.rows
    code = np.empty(16, np.float32)
    for place in range(len(rows)):
        for corner in range(CORNERS):
            first = corner_row(table, rows[place], corner) * CODE_SIZE
            store(code, 0, load_halves(halves, first, first + CODE_SIZE - 8))
            at = (RAY_INPUTS + SIDE_BY_SIDE * corner) * TILE + place
            for k in range(SIDE_BY_SIDE):
                inputs[at + k * TILE] = code[k] * _SCALE


@lean_device
def _fill_place(rays, nearby, pixels, rows, work, inputs, luminances):  # type: ignore[no-untyped-def]
    """Write how pixels look at their voxels, what cells cover of them, and the luminances that are mixed."""
    scale = np.float32(1.0 / LUMINANCE_SCALE)
    covered = inputs[COVERED * TILE :]
    clear_tile(work[0], covered, luminances)
    for place in range(len(rows)):
        pixel = pixels[place]
        node = rays.node[pixel]
        ray = rays.entry[pixel], rays.direction[pixel], rays.up[pixel], rays.ratio[pixel]
        place_pixel(nearby, (node, rows[place]), ray, work, inputs[VIEWS * TILE :], covered, luminances, place)
        luminances[COVERING * TILE + place] = np.float32(nearby.luminance[node]) * scale
    measure_tile(work[0], covered, luminances)
