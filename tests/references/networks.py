# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks in plain NumPy: the encoder, the paper's decoder (methods 7.13 to 7.15), that of the mixture (11.1)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from patchnet.patchnet_addon.network.harmonics import harmonic_terms
from patchnet.patchnet_addon.network.kinds import (
    CODE_SIZE,
    CORNERS,
    COVERED,
    COVERING,
    MIXTURE,
    OUTPUT_LOW,
    OUTPUT_RANGE,
    PAPER,
    RAY_INPUTS,
    SIDE_BY_SIDE,
    VIEWS,
)
from patchnet.patchnet_addon.network.weights import CHANNELS, MODULATED, Weights

BLOCK = 4096  # pixels at once: the layers' values stay in the cache (methods 4.5)


class NumpyEncoder:
    """`Encoder` by the definition: the layers on whole patches (methods 7.9, 7.12)."""

    chunk = 4096

    def __init__(self, weights: Weights) -> None:
        self._layers, self._side = weights.encoder, 1 << weights.lookahead

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Encode as `Encoder` says."""
        eight = blocks[rows].reshape(-1, 2, 2, 2, *[self._side] * 3, CHANNELS)  # octant and cell of z, y, x; channel
        values = eight.transpose(0, 1, 4, 2, 5, 3, 6, 7).reshape(len(rows), -1)
        for index, (matrix, bias) in enumerate(self._layers):
            values = (np.maximum(values, 0) if index else values) @ matrix.T + bias
        return values


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


@dataclass(frozen=True, eq=False)
class MixtureInputs:
    """What the decoder is given of N pixels, all float32.

    codes: (N, 10) interpolated codes. corner_codes: (N, 8, 4) first numbers of those of the hit voxel's corners, x
    fastest. direction, up: (N, 3) unit vectors in octree axes. ratio: (N,) pixel-voxel ratio. view: (N, 9) direction,
    entry point from -1 to 1, and up in the ray frame. covered: (N, 64) share of the pixel that each child and each
    outer cell would cover alone, 0 for those that do not exist. luminances: (N, 65) theirs, and the voxel's own.
    """

    codes: np.ndarray
    corner_codes: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray
    view: np.ndarray
    covered: np.ndarray
    luminances: np.ndarray

    def part(self, block: slice) -> MixtureInputs:
        """Inputs of some of the pixels."""
        return MixtureInputs(*(getattr(self, field.name)[block] for field in fields(self)))


def decode_mixture(weights: Weights, inputs: MixtureInputs) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (N,) in [0, 1] and luminance (N,), float32, of what the network expects behind N pixels."""
    count = len(inputs.ratio)
    coverage, luminance = np.empty(count, np.float32), np.empty(count, np.float32)
    for start in range(0, count, BLOCK):
        block = slice(start, min(start + BLOCK, count))
        coverage[block], luminance[block] = _decode_block(weights, inputs.part(block))
    return coverage, luminance


def _decode_block(weights: Weights, given: MixtureInputs) -> tuple[np.ndarray, np.ndarray]:
    values = np.empty((MIXTURE.decoder[0], len(given.ratio)), np.float32)
    fill_ray_inputs(values, given.codes, given.direction, given.up, given.ratio)
    values[RAY_INPUTS:VIEWS] = given.corner_codes.reshape(-1, CORNERS * SIDE_BY_SIDE).T
    values[VIEWS:COVERED] = given.view.T
    values[COVERED:] = given.covered.T
    outputs = run_decoder(weights, values)
    shares = mixture_shares(outputs[1:].T, given.covered)
    luminance = (shares * given.luminances).sum(axis=1)
    return np.clip(sigmoid_output(outputs[0]), 0, 1), luminance


def mixture_shares(logits: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Shares (N, 65) of luminances, which are 1 together: e^logit (N, 65) times what is covered (N, 64).

    The voxel's own luminance stands last, and counts as if it covered the pixel.
    """
    weights = np.concatenate([covered, np.ones((len(covered), 1), np.float32)], axis=1)
    assert weights.shape[1] == COVERING + 1
    largest = np.where(weights > 0, logits, -np.inf).max(axis=1, keepdims=True)
    shares = weights * np.exp(np.minimum(logits - largest, 0))
    return np.asarray(shares / shares.sum(axis=1, keepdims=True), np.float32)
