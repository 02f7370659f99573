# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's decoder in NumPy: the reference of the compiled one, from codes and rays (methods 7.13 to 7.15)."""

from __future__ import annotations

import numpy as np

from .harmonics import harmonic_terms
from .kinds import CODE_SIZE, PAPER
from .weights import MODULATED, Weights

BLOCK = 4096  # pixels at once: the layers' values stay in the cache (methods 4.5)
OUTPUT_LOW, OUTPUT_RANGE = -1.0, 3.0  # out = -1 + 3 sigmoid(x)


def decode(
    weights: Weights, codes: np.ndarray, direction: np.ndarray, up: np.ndarray, ratio: np.ndarray, *, clip: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (N,) and luminance (N,), float32, of what the network expects behind N pixels.

    codes: (N, 10) interpolated codes. direction, up: (N, 3) unit vectors in octree axes (methods 7.14). ratio: (N,)
    pixel-voxel ratio. `clip`: to [0, 1], as at inference; in training the network speaks in [-1, 2].
    """
    count = len(codes)
    outputs = np.empty((2, count), np.float32)
    inputs = np.empty((PAPER.decoder[0], min(BLOCK, count)), np.float32)
    for start in range(0, count, BLOCK):
        block = slice(start, min(start + BLOCK, count))
        values = inputs[:, : block.stop - start]
        fill_ray_inputs(values, codes[block], direction[block], up[block], ratio[block])
        outputs[:, block] = sigmoid_output(run_decoder(weights, values))
    if clip:
        np.clip(outputs, 0, 1, out=outputs)
    return outputs[0], outputs[1]


def run_decoder(weights: Weights, values: np.ndarray) -> np.ndarray:
    """Last layer's values (outputs, n) float32 for inputs (inputs, n)."""
    for matrix, bias in weights.decoder[:-1]:
        values = matrix @ values
        values += bias[:, None]
        np.maximum(values, 0, out=values)
    matrix, bias = weights.decoder[-1]
    result: np.ndarray = matrix @ values + bias[:, None]
    return result


def sigmoid_output(logits: np.ndarray) -> np.ndarray:
    """Values in [-1, 2] of the last layer's, bounded so that far ones saturate without an overflow warning."""
    result: np.ndarray = OUTPUT_LOW + OUTPUT_RANGE / (1 + np.exp(-np.clip(logits, -80, 80)))
    return result


def fill_ray_inputs(
    inputs: np.ndarray, codes: np.ndarray, direction: np.ndarray, up: np.ndarray, ratio: np.ndarray
) -> None:
    """Write the inputs (42, n) of code and ray, one feature a row: rows are contiguous, and BLAS does the layers."""
    inputs[:CODE_SIZE] = codes.T
    inputs[CODE_SIZE : CODE_SIZE + 3] = direction.T
    inputs[CODE_SIZE + 3 : CODE_SIZE + 6] = up.T
    inputs[CODE_SIZE + 6] = ratio
    x, y, z = inputs[CODE_SIZE : CODE_SIZE + 3]
    for index, term in enumerate(harmonic_terms(x, y, z)):
        inputs[CODE_SIZE + 7 + index] = term
        if index < MODULATED:
            inputs[index] *= term
