# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers of the compiled decoders: a tile of pixels passes through them with values in the nearest caches.

Features are rows of a tile and pixels its columns, so that a vector holds the same feature of many pixels. The sums of
six outputs stay in registers while inputs are read. The result of a pixel is bitwise independent of the other pixels of
its tile; only processors without fused multiply-add have other bits.
"""

from __future__ import annotations

import numpy as np

from ..runtime.bits import float_of_bits
from ..runtime.kernels import device
from ..runtime.vectors import LANES, add_product, larger, load, spread, store
from .kinds import CODE_SIZE, OUTPUT_LOW, OUTPUT_RANGE, WIDTH_STEP
from .simd_harmonics import store_harmonics
from .weights import MODULATED

TILE = 64  # pixels: with 78 features before and after a layer 39 KiB, and a whole number of vectors everywhere
OUTPUTS = WIDTH_STEP  # outputs of a layer at once: their sums take 12 of 16 short registers

_LINE = 16  # numbers that a line of the cache holds
DIRECTION, UP, RATIO = CODE_SIZE, CODE_SIZE + 3, CODE_SIZE + 6  # rows of inputs; the first ones are the code
FIRST_HARMONIC = RATIO + 1
assert TILE % LANES == 0

_LOG2_E = np.float32(1.4426950408889634)
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_LOW, _RANGE = np.float32(OUTPUT_LOW), np.float32(OUTPUT_RANGE)


@device
def empty_values(rows):
    """Values of a tile, (rows * TILE,) float32 zeros at a multiple of 64 bytes: a vector lies in one cache line."""
    memory = np.zeros(rows * TILE + _LINE, np.float32)  # NumPy aligns to 16 bytes only
    before = (4 * _LINE - memory.ctypes.data % (4 * _LINE)) % (4 * _LINE) // 4
    return memory[before : before + rows * TILE]


@device
def fill_harmonics(inputs):
    """Write the harmonics of the directions, and multiply the first of them into the codes (methods 7.13)."""
    for pixel in range(0, TILE, LANES):
        at = DIRECTION * TILE + pixel
        x, y, z = load(inputs, at), load(inputs, at + TILE), load(inputs, at + 2 * TILE)
        store_harmonics(inputs, FIRST_HARMONIC * TILE + pixel, TILE, x, y, z)
        for k in range(MODULATED):
            at = k * TILE + pixel
            store(inputs, at, load(inputs, at) * load(inputs, FIRST_HARMONIC * TILE + at))


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
