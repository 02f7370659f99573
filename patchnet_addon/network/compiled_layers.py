# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoders for kernels, and their layers: a tile of pixels passes them with values in the nearest caches.

Features are rows of a tile and pixels its columns, so that a vector holds the same feature of many pixels. The sums of
six outputs stay in registers while inputs are read. The result of a pixel is bitwise independent of the other pixels of
its tile; only processors without fused multiply-add have other bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import array_device, device
from ..runtime.vectors import LANES, add_product, float_of_bits, larger, load, spread, store
from .harmonics import harmonic_terms
from .kinds import CODE_SIZE, COVERED, COVERING, MIXED, MIXTURE, OUTPUT_LOW, OUTPUT_RANGE, PAPER, WIDTH_STEP
from .weights import MODULATED, Weights

TILE = 64  # pixels: with 78 features before and after a layer 39 KiB, and a whole number of vectors everywhere
OUTPUTS = WIDTH_STEP  # outputs of a layer at once: their sums take 12 of 16 short registers

_LINE = 16  # numbers that a line of the cache holds
DIRECTION, UP, RATIO = CODE_SIZE, CODE_SIZE + 3, CODE_SIZE + 6  # rows of inputs; the first ones are the code
FIRST_HARMONIC = RATIO + 1
assert TILE % LANES == 0

_terms = device(harmonic_terms)

_LOG2_E = np.float32(1.4426950408889634)
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_LOW, _RANGE = np.float32(OUTPUT_LOW), np.float32(OUTPUT_RANGE)

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


@array_device
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


@array_device
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


@array_device
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


@array_device
def empty_values(rows):
    """Values of a tile, (rows * TILE,) float32 zeros at a multiple of 64 bytes: a vector lies in one cache line."""
    memory = np.zeros(rows * TILE + _LINE, np.float32)  # NumPy aligns to 16 bytes only
    before = (4 * _LINE - memory.ctypes.data % (4 * _LINE)) % (4 * _LINE) // 4
    return memory[before : before + rows * TILE]


@device
def fill_harmonics(inputs):
    """Write the harmonics of the directions, and multiply the first of them into the codes (methods 7.13)."""
    for pixel in range(TILE):
        at = DIRECTION * TILE + pixel
        terms = _terms(inputs[at], inputs[at + TILE], inputs[at + 2 * TILE])
        for k in range(len(terms)):
            inputs[(FIRST_HARMONIC + k) * TILE + pixel] = terms[k]
        for k in range(MODULATED):
            inputs[k * TILE + pixel] *= inputs[(FIRST_HARMONIC + k) * TILE + pixel]


@device
def apply_layer(inputs, depth, results, hidden, weights, bias, floor):
    """Layer with ReLU from `depth` rows of inputs to `hidden` rows of results, a multiple of `OUTPUTS`."""
    low = spread(floor, 0)
    for output in range(0, hidden, OUTPUTS):
        for pixel in range(0, TILE, LANES):
            sum0, sum1, sum2 = spread(bias, output), spread(bias, output + 1), spread(bias, output + 2)
            sum3, sum4, sum5 = spread(bias, output + 3), spread(bias, output + 4), spread(bias, output + 5)
            weight = output * depth
            for row in range(depth):
                values = load(inputs, row * TILE + pixel)
                sum0 = add_product(sum0, values, spread(weights, weight))
                sum1 = add_product(sum1, values, spread(weights, weight + 1))
                sum2 = add_product(sum2, values, spread(weights, weight + 2))
                sum3 = add_product(sum3, values, spread(weights, weight + 3))
                sum4 = add_product(sum4, values, spread(weights, weight + 4))
                sum5 = add_product(sum5, values, spread(weights, weight + 5))
                weight += OUTPUTS
            at = output * TILE + pixel
            store(results, at, larger(low, sum0))
            store(results, at + TILE, larger(low, sum1))
            store(results, at + 2 * TILE, larger(low, sum2))
            store(results, at + 3 * TILE, larger(low, sum3))
            store(results, at + 4 * TILE, larger(low, sum4))
            store(results, at + 5 * TILE, larger(low, sum5))


@device
def exponential(power):
    """e^power, |power| <= 80: 2^n e^r with |r| <= ln 2 / 2, the polynomial of Cephes' expf.

    The compiler vectorizes plain loops over this arithmetic.
    """
    whole = np.floor(power * _LOG2_E + np.float32(0.5))
    r = power - whole * _LN2_HIGH - whole * _LN2_LOW
    terms = np.float32(1.9875691500e-4) * r + np.float32(1.3981999507e-3)
    terms = terms * r + np.float32(8.3334519073e-3)
    terms = terms * r + np.float32(4.1665795894e-2)
    terms = terms * r + np.float32(1.6666665459e-1)
    terms = terms * r + np.float32(5.0000001201e-1)
    terms = terms * r * r + r + np.float32(1)
    return terms * float_of_bits(np.int32((np.int32(whole) + np.int32(127)) << np.int32(23)))


@device
def clipped_sigmoid(value):
    """Output of a network, clip(-1 + 3 / (1 + e^-x)), of the last layer's value x (methods 7.15)."""
    one = np.float32(1)
    output = _LOW + _RANGE / (one + exponential(min(max(-value, np.float32(-80)), np.float32(80))))
    return min(max(output, np.float32(0)), one)
