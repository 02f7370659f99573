# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's decoder for kernels: the layers of `decode.py` for a tile of pixels, whose values stay in the L1 cache.

Features are rows of a tile and pixels its columns, so that a vector holds the same feature of many pixels. The sums of
six outputs stay in registers while the inputs pass by. A pixel has the same bits in whatever company it is decoded;
only a processor that cannot multiply and add in one rounding has others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device
from ..runtime.vectors import larger, store
from .decode import OUTPUT_LOW, OUTPUT_RANGE
from .lane_harmonics import store_harmonics
from .lanes import LANES, WIDE_LANES, add_product, load, load_wide, spread_wide
from .weights import CODE_SIZE, DECODER_SIZES, HARMONICS, MODULATED, Weights

TILE = 64  # pixels: with 48 features before and after a layer 24 KiB, and a whole number of vectors everywhere
OUTPUTS = 6  # of a layer at once: 24 registers of sums where there are 32, 12 where there are 16
TILE_VALUES = max(DECODER_SIZES) * TILE  # of a tile's features

DIRECTION, UP, RATIO = CODE_SIZE, CODE_SIZE + 3, CODE_SIZE + 6  # rows of inputs; the code stands in the first ones
_HARMONICS = RATIO + 1
_INPUTS, _HIDDEN = DECODER_SIZES[:2]
_LAYERS = len(DECODER_SIZES) - 2  # with ReLU
assert (_HARMONICS + HARMONICS, *[_HIDDEN] * _LAYERS, 2) == DECODER_SIZES
assert _HIDDEN % OUTPUTS == 0 and TILE % WIDE_LANES == 0

_LOG2_E = np.float32(1.4426950408889634)
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_LOW, _RANGE = np.float32(OUTPUT_LOW), np.float32(OUTPUT_RANGE)


class DecoderLayers(NamedTuple):
    """Decoder as `decode_tile` reads it, flat.

    hidden: (6624,) float32, of each layer with ReLU, of each six outputs, for each input its six weights.
    last: (96,) float32, for each input its two weights.
    bias: (146,) float32, of all layers.
    floor: (1,) float32, zero, in memory, from where it is spread over a vector.
    """

    hidden: np.ndarray
    last: np.ndarray
    bias: np.ndarray
    floor: np.ndarray

    @classmethod
    def pack(cls, weights: Weights) -> DecoderLayers:
        """Layers of the decoder."""
        hidden = [matrix.reshape(-1, OUTPUTS, matrix.shape[1]).swapaxes(1, 2) for matrix, _ in weights.decoder[:-1]]
        return cls(
            np.concatenate([blocks.ravel() for blocks in hidden]),
            weights.decoder[-1][0].T.ravel(),
            np.concatenate([bias for _, bias in weights.decoder]),
            np.zeros(1, np.float32),
        )


@device
def empty_tile():
    """Values of a tile, (48 * TILE,) float32 zeros at a multiple of 64 bytes: a vector lies in one cache line."""
    values = np.zeros(TILE_VALUES + 16, np.float32)
    start = -(values.ctypes.data // 4) % 16
    return values[start : start + TILE_VALUES]


@device
def decode_tile(inputs, others, layers):
    """Decode a tile of pixels: one of the two arrays is returned, whose first two rows are coverage and luminance.

    inputs: (48 * TILE,) float32, rows of code, direction, up and ratio; they are not kept. others: as large.
    """
    hidden, last, bias, floor = layers
    _fill_inputs(inputs)
    depth, weight = _INPUTS, 0
    for layer in range(_LAYERS):
        _apply_layer(inputs, depth, others, hidden[weight:], bias[layer * _HIDDEN :], floor)
        weight += depth * _HIDDEN
        depth = _HIDDEN
        inputs, others = others, inputs
    _apply_last(inputs, others, last, bias[_LAYERS * _HIDDEN :])
    return others


@device
def _fill_inputs(inputs):
    """Write the harmonics of the directions, and multiply the first of them into the codes (methods 7.13)."""
    for pixel in range(0, TILE, LANES):
        at = DIRECTION * TILE + pixel
        x, y, z = load(inputs, at), load(inputs, at + TILE), load(inputs, at + 2 * TILE)
        store_harmonics(inputs, _HARMONICS * TILE + pixel, TILE, x, y, z)
        for k in range(MODULATED):
            at = k * TILE + pixel
            store(inputs, at, load(inputs, at) * load(inputs, _HARMONICS * TILE + at))


@device
def _apply_layer(inputs, depth, results, weights, bias, floor):
    """Layer with ReLU from `depth` rows of inputs to 48 rows of results."""
    low = spread_wide(floor, 0)
    for output in range(0, _HIDDEN, OUTPUTS):
        for pixel in range(0, TILE, WIDE_LANES):
            sum0, sum1, sum2 = spread_wide(bias, output), spread_wide(bias, output + 1), spread_wide(bias, output + 2)
            sum3, sum4, sum5 = (
                spread_wide(bias, output + 3),
                spread_wide(bias, output + 4),
                spread_wide(bias, output + 5),
            )
            weight = output * depth
            for row in range(depth):
                values = load_wide(inputs, row * TILE + pixel)
                sum0 = add_product(sum0, values, spread_wide(weights, weight))
                sum1 = add_product(sum1, values, spread_wide(weights, weight + 1))
                sum2 = add_product(sum2, values, spread_wide(weights, weight + 2))
                sum3 = add_product(sum3, values, spread_wide(weights, weight + 3))
                sum4 = add_product(sum4, values, spread_wide(weights, weight + 4))
                sum5 = add_product(sum5, values, spread_wide(weights, weight + 5))
                weight += OUTPUTS
            at = output * TILE + pixel
            store(results, at, larger(low, sum0))
            store(results, at + TILE, larger(low, sum1))
            store(results, at + 2 * TILE, larger(low, sum2))
            store(results, at + 3 * TILE, larger(low, sum3))
            store(results, at + 4 * TILE, larger(low, sum4))
            store(results, at + 5 * TILE, larger(low, sum5))


@device
def _apply_last(inputs, results, weights, bias):
    """Last layer with its sigmoid, clipped to [0, 1] (methods 7.15): rows of coverage and luminance."""
    for pixel in range(0, TILE, WIDE_LANES):
        coverage, luminance = spread_wide(bias, 0), spread_wide(bias, 1)
        for row in range(_HIDDEN):
            values = load_wide(inputs, row * TILE + pixel)
            coverage = add_product(coverage, values, spread_wide(weights, 2 * row))
            luminance = add_product(luminance, values, spread_wide(weights, 2 * row + 1))
        store(results, pixel, coverage)
        store(results, TILE + pixel, luminance)
    bits = results.view(np.int32)
    for index in range(2 * TILE):  # plain loops, which the compiler makes vectors of
        _write_sigmoid(results, bits, index)


@device
def _write_sigmoid(values, bits, index):
    """Write clip(-1 + 3 / (1 + e^-x)) over x; e^y = 2^n e^r with |r| <= ln 2 / 2, the polynomial of Cephes' expf."""
    one = np.float32(1)
    y = min(max(-values[index], np.float32(-80)), np.float32(80))
    whole = np.floor(y * _LOG2_E + np.float32(0.5))
    r = y - whole * _LN2_HIGH - whole * _LN2_LOW
    terms = np.float32(1.9875691500e-4) * r + np.float32(1.3981999507e-3)
    terms = terms * r + np.float32(8.3334519073e-3)
    terms = terms * r + np.float32(4.1665795894e-2)
    terms = terms * r + np.float32(1.6666665459e-1)
    terms = terms * r + np.float32(5.0000001201e-1)
    terms = terms * r * r + r + one
    bits[index] = (np.int32(whole) + np.int32(127)) << np.int32(23)
    output = _LOW + _RANGE / (one + terms * values[index])
    values[index] = min(max(output, np.float32(0)), one)
