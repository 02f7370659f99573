# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's decoders for kernels: layers on a tile of pixels, with values in the nearest caches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device
from .compiled_layers import OUTPUTS, TILE, apply_layer, clipped_sigmoid, empty_values, exponential, fill_harmonics
from .kinds import COVERED, COVERING, MIXED, MIXTURE, PAPER
from .weights import Weights

_ROWS = MIXTURE.decoder[0]
_LAYERS = len(MIXTURE.decoder) - 2  # with ReLU
# Results overwrite inputs, before the covered shares, which are still needed.
assert len(PAPER.decoder) == len(MIXTURE.decoder) and _LAYERS % 2 == 1


class DecoderLayers(NamedTuple):
    """Decoder in the form of kernels, flat, all float32.

    weights: of each layer, of each six outputs, for each input its six weights. bias: of all layers. Both are padded
    with zeros to six outputs. floor: (2,) the smallest result of a layer, and of the last. inputs, width, outputs: of
    the first layer, of those with ReLU, and of the last.
    """

    weights: np.ndarray
    bias: np.ndarray
    floor: np.ndarray
    inputs: int
    width: int
    outputs: int

    @classmethod
    def pack(cls, weights: Weights) -> DecoderLayers:
        """Layers of the decoder."""
        blocks, biases = [], []
        for matrix, bias in weights.decoder:
            more = -len(matrix) % OUTPUTS
            filled = np.pad(matrix, ((0, more), (0, 0)))
            blocks.append(filled.reshape(-1, OUTPUTS, matrix.shape[1]).swapaxes(1, 2).ravel())
            biases.append(np.pad(bias, (0, more)))
        floor = np.array([0, -np.inf], np.float32)  # in memory, to be broadcast to a vector
        inputs, width = weights.decoder[0][0].shape[1], len(biases[0])
        return cls(np.concatenate(blocks), np.concatenate(biases), floor, inputs, width, len(biases[-1]))


@device
def empty_tile():
    """Two arrays of a tile's values, (147 * TILE,) float32 zeros, and one of luminances, (65 * TILE,)."""
    return empty_values(_ROWS), empty_values(_ROWS), empty_values(MIXED)


@device
def decode_tile(tile, layers):
    """Decode a tile of pixels by the paper's network; its first two rows become coverage and luminance.

    tile: `empty_tile`, with rows of code, direction, up and ratio. layers: `DecoderLayers`.
    """
    inputs, others, _ = tile
    _run_layers(inputs, others, layers)
    for index in range(2 * TILE):
        inputs[index] = clipped_sigmoid(inputs[index])


@device
def decode_mixture_tile(tile, layers):
    """Decode a tile of pixels by a luminance mixture; its first two rows become coverage and luminance.

    tile: `empty_tile`, with the rows of `kinds.py` except harmonics, and rows of luminances. layers: `DecoderLayers`.
    """
    inputs, others, luminances = tile
    _run_layers(inputs, others, layers)
    for pixel in range(TILE):
        inputs[pixel] = clipped_sigmoid(inputs[pixel])
    _mix(inputs, luminances)


@device
def _run_layers(inputs, others, layers):
    """Run all layers; the first rows of `inputs` become the results."""
    weights, bias, floor, depth, width, outputs = layers
    fill_harmonics(inputs)
    weight = 0
    values, results = inputs, others
    for layer in range(_LAYERS):
        apply_layer(values, depth, results, width, weights[weight:], bias[layer * width :], floor)
        weight += depth * width
        depth = width
        values, results = results, values
    apply_layer(values, depth, results, outputs, weights[weight:], bias[_LAYERS * width :], floor[1:])


@device
def _mix(values, luminances):
    """Write the mean of the luminances, by shares of the logits in rows 1 to 65, into row 1."""
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
