# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict coverage and luminance behind each pixel's first hit with the network (methods 7.11 to 7.15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..network.compiled_decode import decode_tile, empty_tile
from ..network.compiled_layers import TILE, DecoderLayers
from ..network.compiled_mixture import pack_mixture
from ..runtime.kernels import kernel
from ..runtime.threads import run_parts
from .coded_octree import CodedOctree
from .corner_codes import CornerCodes
from .mixture_inputs import NearbyCells
from .pixel_tiles import PixelRays, fill_codes, fill_rays, gather_look_ahead
from .predict_mixture import predict_mixture

if TYPE_CHECKING:
    from ..tracing.render import Hits


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction for each of P pixels.

    coverage: (P,) float32, sigma, share of the pixel that the patch covers; 1 where nothing is known.
    luminance: (P,) float32, L_N, mean luminance of that share; that of the preview where nothing is known.
    look_ahead: (P,) bool, the hit voxel has descendants as deep as the patch looks (methods 4.1b); false for misses.
    """

    coverage: np.ndarray
    luminance: np.ndarray
    look_ahead: np.ndarray

    def part(self, pixels: np.ndarray) -> Prediction:
        """Prediction for some of the pixels, given by their indices (N,)."""
        return Prediction(self.coverage[pixels], self.luminance[pixels], self.look_ahead[pixels])


def predict(coded: CodedOctree, hits: Hits) -> Prediction:
    """Decode coverage and luminance of all pixels, on all cores of the CPU.

    Those without look-ahead keep what they show, so that their priority is 0 (methods 4.1b). A GPU is no faster: what
    lies around each pixel's voxel is found on the CPU, and would have to be copied (docs/gpu.md).
    """
    rays = PixelRays.of(hits)
    pixels = len(rays.node)
    prediction = Prediction(
        np.ones(pixels, np.float32), np.array(hits.luminance, np.float32), np.zeros(pixels, np.bool_)
    )
    results = prediction.coverage, prediction.luminance, prediction.look_ahead
    parts = -(-pixels // TILE)
    if coded.weights.kind.mixes:
        nearby, layers = NearbyCells.of(coded), pack_mixture(coded.weights)
        run_parts(predict_mixture, parts, rays, CornerCodes.of(coded), nearby, layers, results)
    else:
        run_parts(_predict, parts, rays, CornerCodes.of(coded), DecoderLayers.pack(coded.weights), *results)
    return prediction


def predict_pixels(coded: CodedOctree, hits: Hits, pixels: np.ndarray) -> Prediction:
    """Decode chosen pixels, given by their indices (N,), alone; as `predict` otherwise."""
    return predict(coded, hits.part(pixels))


@kernel
def _predict(first, last, rays, corner_codes, layers, coverage, luminance, look_ahead):  # type: ignore[no-untyped-def]
    """Write coverage and luminance of the pixels with look-ahead in runs of TILE pixels, and which these are.

    They are gathered, and decoded when they fill a tile.
    """
    tile = empty_tile(), empty_tile()
    pixels, rows = np.empty(TILE, np.int64), np.empty(TILE, np.int64)
    pixel, end = first * TILE, min(last * TILE, len(coverage))
    while pixel < end:
        count, pixel = gather_look_ahead(rays.node, corner_codes, pixel, end, pixels, rows, look_ahead)
        if count == 0:
            break
        fill_codes(corner_codes, rows[:count], rays.entry, pixels, tile[0])
        fill_rays(rays, pixels[:count], tile[0])
        outputs = decode_tile(tile[0], tile[1], layers)
        for place in range(count):
            coverage[pixels[place]] = outputs[place]
            luminance[pixels[place]] = outputs[TILE + place]
