# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of the luminance mixture for kernels: `mixture_decode.py` for a tile of pixels (methods 11.1)."""

from __future__ import annotations

import numpy as np

from ..runtime.bounds import DECODER_WIDTH
from ..runtime.kernels import device
from .compiled_layers import (
    OUTPUTS,
    TILE,
    DecoderLayers,
    apply_layer,
    clipped_sigmoid,
    empty_values,
    exponential,
    fill_harmonics,
)
from .kinds import COVERING, MIXED, MIXTURE
from .mixture_decode import COVERED
from .weights import Weights

_INPUTS = MIXTURE.decoder[0]
_LAYERS = len(MIXTURE.decoder) - 2  # with ReLU
_OUTPUTS = MIXTURE.decoder[-1]
assert _OUTPUTS % OUTPUTS == 0
# So that `decode_mixture_tile` still finds what cells cover when the layers have gone through its inputs.
assert _LAYERS % 2 == 1 and max(DECODER_WIDTH.high, _OUTPUTS) <= COVERED


def pack_mixture(weights: Weights) -> DecoderLayers:
    """Layers of the decoder; the last one is packed as the others are, and `floor` has its floor, too."""
    packed = DecoderLayers.pack(weights)
    matrix, _ = weights.decoder[-1]
    last = matrix.reshape(-1, OUTPUTS, matrix.shape[1]).swapaxes(1, 2).ravel()
    return packed._replace(last=last, floor=np.array([0, -np.inf], np.float32))


@device
def empty_mixture_tile():
    """Inputs of a tile, (147 * TILE,) float32 zeros, see `empty_values`."""
    return empty_values(_INPUTS)


@device
def empty_luminances():
    """Luminances of a tile, (65 * TILE,) float32 zeros, see `empty_values`."""
    return empty_values(MIXED)


@device
def decode_mixture_tile(inputs, others, luminances, layers):
    """Decode a tile of pixels: the first two rows of `inputs` are coverage and luminance afterwards.

    inputs: (147 * TILE,) float32, rows as `kinds.py` says, but for the harmonics. others: as large. luminances:
    (65 * TILE,) rows of what is mixed. layers: of `pack_mixture`.
    """
    hidden, last, bias, floor = layers
    width = (len(bias) - _OUTPUTS) // _LAYERS
    fill_harmonics(inputs)
    depth, weight = _INPUTS, 0
    values, results = inputs, others
    for layer in range(_LAYERS):
        apply_layer(values, depth, results, width, hidden[weight:], bias[layer * width :], floor)
        weight += depth * width
        depth = width
        values, results = results, values
    apply_layer(values, depth, results, _OUTPUTS, last, bias[_LAYERS * width :], floor[1:])
    for pixel in range(TILE):
        inputs[pixel] = clipped_sigmoid(inputs[pixel])
    _mix(inputs, luminances)


@device
def _mix(values, luminances):
    """Write the mean of the luminances, by the shares of `mixture_shares` from rows 1 to 65, into row 1."""
    largest, total, light = np.empty(TILE, np.float32), np.empty(TILE, np.float32), np.empty(TILE, np.float32)
    own = (1 + COVERING) * TILE
    for pixel in range(TILE):
        largest[pixel] = values[own + pixel]
    for row in range(COVERING):
        for pixel in range(TILE):
            logit = values[(1 + row) * TILE + pixel]
            there = values[(COVERED + row) * TILE + pixel] > 0
            largest[pixel] = max(largest[pixel], logit) if there else largest[pixel]
    for pixel in range(TILE):
        share = exponential(max(values[own + pixel] - largest[pixel], np.float32(-80)))
        total[pixel] = share
        light[pixel] = share * luminances[COVERING * TILE + pixel]
    for row in range(COVERING):
        for pixel in range(TILE):
            behind = min(max(values[(1 + row) * TILE + pixel] - largest[pixel], np.float32(-80)), np.float32(0))
            share = exponential(behind) * values[(COVERED + row) * TILE + pixel]
            total[pixel] += share
            light[pixel] += share * luminances[row * TILE + pixel]
    for pixel in range(TILE):
        values[TILE + pixel] = light[pixel] / total[pixel]
