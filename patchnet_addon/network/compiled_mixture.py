# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of the luminance mixture for kernels: `mixture_decode.py` for a tile of pixels (methods 11.1)."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device
from .compiled_layers import (
    OUTPUTS,
    TILE,
    DecoderLayers,
    apply_layer,
    empty_values,
    fill_harmonics,
    write_exponential,
    write_sigmoid,
)
from .kinds import CHILDREN, CODE_SIZE, CORNERS, MIXED, MIXTURE
from .mixture_decode import ABSENT, RAY_INPUTS
from .weights import Weights

CORNER_CODES = RAY_INPUTS  # rows of inputs: 80 numbers of the corner codes,
ENTRY = CORNER_CODES + CORNERS * CODE_SIZE  # the entry point,
COVERED = ENTRY + 3  # and the coverage of the children

_INPUTS, _HIDDEN = MIXTURE.decoder[:2]
_LAYERS = len(MIXTURE.decoder) - 2  # with ReLU
_OUTPUTS = MIXTURE.decoder[-1]
assert MIXTURE.decoder[1:] == (*[_HIDDEN] * _LAYERS, 1 + MIXED)
assert _HIDDEN % OUTPUTS == 0 and _OUTPUTS % OUTPUTS == 0
assert _LAYERS % 2 == 1 and _HIDDEN <= COVERED  # so that `decode_mixture_tile` still finds the coverage


def pack_mixture(weights: Weights) -> DecoderLayers:
    """Layers of the decoder; the last one is packed as the others are, and `floor` has its floor, too."""
    packed = DecoderLayers.pack(weights)
    matrix, _ = weights.decoder[-1]
    last = matrix.reshape(-1, OUTPUTS, matrix.shape[1]).swapaxes(1, 2).ravel()
    return packed._replace(last=last, floor=np.array([0, -np.inf], np.float32))


@device
def empty_mixture_tile():
    """Inputs of a tile, (133 * TILE,) float32 zeros, see `empty_values`."""
    return empty_values(_INPUTS)


@device
def empty_luminances():
    """Luminances of a tile, (17 * TILE,) float32 zeros, see `empty_values`."""
    return empty_values(MIXED)


@device
def decode_mixture_tile(inputs, others, luminances, layers):
    """Decode a tile of pixels: the first two rows of `inputs` are coverage and luminance afterwards.

    inputs: (133 * TILE,) float32, rows as `kinds.py` says, but for the harmonics. others: as large. luminances:
    (17 * TILE,) rows of what is mixed; they are not kept. layers: of `pack_mixture`.
    """
    hidden, last, bias, floor = layers
    fill_harmonics(inputs)
    depth, weight = _INPUTS, 0
    values, results = inputs, others
    for layer in range(_LAYERS):
        apply_layer(values, depth, results, _HIDDEN, hidden[weight:], bias[layer * _HIDDEN :], floor)
        weight += depth * _HIDDEN
        depth = _HIDDEN
        values, results = results, values
    apply_layer(values, depth, results, _OUTPUTS, last, bias[_LAYERS * _HIDDEN :], floor[1:])
    bits = inputs.view(np.int32)
    for pixel in range(TILE):
        write_sigmoid(inputs, bits, pixel)
    _mix(inputs, bits, luminances)


@device
def _mix(values, bits, luminances):
    """Write the mean of the luminances, by the softmax of rows 1 to 17, into row 1."""
    largest, total = np.empty(TILE, np.float32), np.zeros(TILE, np.float32)
    for pixel in range(TILE):
        largest[pixel] = values[(1 + CHILDREN) * TILE + pixel]
    for row in range(MIXED):
        for pixel in range(TILE):
            at = (1 + row) * TILE + pixel
            if row < CHILDREN and values[(COVERED + row) * TILE + pixel] == 0:
                values[at] = ABSENT
            largest[pixel] = max(largest[pixel], values[at])
    for row in range(MIXED):
        for pixel in range(TILE):
            at = (1 + row) * TILE + pixel
            write_exponential(values, bits, at, max(values[at] - largest[pixel], np.float32(-80)))
            total[pixel] += values[at]
            luminances[row * TILE + pixel] *= values[at]
    for pixel in range(TILE):
        mean = luminances[pixel]
        for row in range(1, MIXED):
            mean += luminances[row * TILE + pixel]
        values[TILE + pixel] = mean / total[pixel]
