# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's decoder for kernels: the layers of `decode.py` for a tile of pixels, whose values stay in the L1 cache."""

from __future__ import annotations

from ..runtime.kernels import device
from ..runtime.vectors import store
from .compiled_layers import OUTPUTS, TILE, apply_layer, clipped_sigmoid, empty_values, fill_harmonics
from .kinds import PAPER
from .simd import WIDE_LANES, add_product, load_wide, spread_wide

_INPUTS, _HIDDEN = PAPER.decoder[:2]
_LAYERS = len(PAPER.decoder) - 2  # with ReLU
_ROWS = max(PAPER.decoder)
assert PAPER.decoder[1:] == (*[_HIDDEN] * _LAYERS, 2)
assert _HIDDEN % OUTPUTS == 0


@device
def empty_tile():
    """Values of a tile, (48 * TILE,) float32 zeros, see `empty_values`."""
    return empty_values(_ROWS)


@device
def decode_tile(inputs, others, layers):
    """Decode a tile of pixels: one of the two arrays is returned, whose first two rows are coverage and luminance.

    inputs: (48 * TILE,) float32, rows of code, direction, up and ratio; they are not kept. others: as large. layers:
    `DecoderLayers`.
    """
    hidden, last, bias, floor = layers
    fill_harmonics(inputs)
    depth, weight = _INPUTS, 0
    for layer in range(_LAYERS):
        apply_layer(inputs, depth, others, _HIDDEN, hidden[weight:], bias[layer * _HIDDEN :], floor)
        weight += depth * _HIDDEN
        depth = _HIDDEN
        inputs, others = others, inputs
    _apply_last(inputs, others, last, bias[_LAYERS * _HIDDEN :])
    return others


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
    for index in range(2 * TILE):
        results[index] = clipped_sigmoid(results[index])
