# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict coverage and luminance behind each pixel's first hit with the network (methods 7.11 to 7.15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..network.compiled_decode import DecoderLayers, decode_mixture_tile, decode_tile, empty_tile
from ..network.compiled_layers import TILE
from ..network.kinds import CODE_SIZE, CORNERS, COVERED, COVERING, RAY_INPUTS, SIDE_BY_SIDE, VIEWS
from ..octree.octree import LUMINANCE_SCALE
from ..octree.side_kernels import luminance_along
from ..runtime.kernels import device, kernel, lean_device
from ..runtime.threads import run_parts
from ..runtime.vectors import HALF_SCALE, load_halves, store
from .coded_octree import CodedOctree
from .corner_rows import corner_row
from .fine_cells import empty_fine_list
from .footprint import clear_tile, empty_footprint_tile, measure_tile
from .mixture_inputs import NearbyCells, place_pixel
from .outer_cells import empty_outer_list
from .pixel_tiles import CornerCodes, PixelRays, fill_codes, fill_rays, gather_look_ahead

if TYPE_CHECKING:
    from ..tracing.render import Hits

_SCALE = np.float32(HALF_SCALE)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction for each of P pixels.

    coverage: (P,) float32, sigma, share of the pixel that the patch covers; 1 without look-ahead.
    luminance: (P,) float32, L_N, mean luminance of that share; that of the preview without look-ahead. look_ahead: (P,)
    bool, the hit voxel has descendants at the patch's depth (methods 4.1b); false for misses.
    """

    coverage: np.ndarray
    luminance: np.ndarray
    look_ahead: np.ndarray

    def __getitem__(self, pixels: np.ndarray) -> Prediction:
        """Prediction for pixels by index (N,)."""
        return Prediction(self.coverage[pixels], self.luminance[pixels], self.look_ahead[pixels])

    def __setitem__(self, pixels: np.ndarray, found: Prediction) -> None:
        """Replace the prediction of pixels by index (N,)."""
        self.coverage[pixels], self.luminance[pixels] = found.coverage, found.luminance
        self.look_ahead[pixels] = found.look_ahead


def predict(coded: CodedOctree, hits: Hits) -> Prediction:
    """Decode coverage and luminance of all pixels, on all cores of the CPU.

    Pixels without look-ahead keep their preview, so that their priority is 0 (methods 4.1b). A GPU is no faster: the
    cells around each pixel's voxel are found on the CPU and would have to be copied (docs/gpu.md).
    """
    rays = PixelRays.of(hits)
    pixels = len(rays.node)
    prediction = Prediction(
        np.ones(pixels, np.float32), np.array(hits.luminance, np.float32), np.zeros(pixels, np.bool_)
    )
    results = prediction.coverage, prediction.luminance, prediction.look_ahead
    nearby = NearbyCells.of(coded) if coded.weights.kind.mixes else None
    layers = DecoderLayers.pack(coded.weights)
    run_parts(_predict, -(-pixels // TILE), rays, CornerCodes.of(coded), nearby, layers, results)
    return prediction


@kernel
def _predict(first, last, rays, corner_codes, nearby, layers, results):  # type: ignore[no-untyped-def]
    """Write coverage and luminance of the pixels with look-ahead in runs of TILE pixels, and the mask of these pixels.

    They are gathered, and decoded when a tile is full. rays: `PixelRays`. corner_codes: `CornerCodes`. nearby:
    `NearbyCells` of a luminance mixture, None for the paper's network; each case is compiled. results: coverage,
    luminance, and the mask of look-ahead.
    """
    coverage, luminance, look_ahead = results
    tile = empty_tile()
    inputs, _, luminances = tile
    work = empty_footprint_tile(), empty_fine_list(), empty_outer_list()
    pixels, rows = np.empty(TILE, np.int64), np.empty(TILE, np.int64)
    pixel, end = first * TILE, min(last * TILE, len(coverage))
    while pixel < end:
        count, pixel = gather_look_ahead(rays.node, corner_codes, pixel, end, pixels, rows, look_ahead)
        if count == 0:
            break
        fill_codes(corner_codes, rows[:count], rays.entry, pixels, inputs)
        fill_rays(rays, pixels[:count], inputs)
        if nearby is None:
            decode_tile(tile, layers)
        else:
            _fill_corners(corner_codes, rows[:count], inputs)
            _fill_place(rays, nearby, pixels, rows[:count], work, inputs, luminances)
            decode_mixture_tile(tile, layers)
        for place in range(count):
            coverage[pixels[place]] = inputs[place]
            luminance[pixels[place]] = inputs[TILE + place]


@device
def _fill_corners(corner_codes, rows, inputs):  # type: ignore[no-untyped-def]
    """Write the first numbers of the eight corner codes of pixels side by side; rows: of the hit nodes."""
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
    """Write the viewing rays of pixels, the shares that cells cover, and the luminances to mix."""
    scale = np.float32(1.0 / LUMINANCE_SCALE)
    covered = inputs[COVERED * TILE :]
    clear_tile(work[0], covered, luminances)
    for place in range(len(rows)):
        pixel = pixels[place]
        node = rays.node[pixel]
        ray = rays.entry[pixel], rays.direction[pixel], rays.up[pixel], rays.ratio[pixel]
        place_pixel(nearby, (node, rows[place]), ray, work, inputs[VIEWS * TILE :], covered, luminances, place)
        x, y, z = ray[1][0], ray[1][1], ray[1][2]
        luminances[COVERING * TILE + place] = luminance_along(nearby.light, node, x, y, z) * scale
    measure_tile(work[0], covered, luminances)
