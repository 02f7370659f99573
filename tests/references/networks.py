# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks in plain NumPy: the encoder, the paper's decoder (methods 7.13 to 7.15), the mixture's decoder (11.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from patchnet.patchnet_addon.network.harmonics import real_harmonics
from patchnet.patchnet_addon.network.kinds import CORNERS, COVERING, OUTPUT_LOW, OUTPUT_RANGE, SIDE_BY_SIDE
from patchnet.patchnet_addon.network.weights import CHANNELS, MODULATED, Layer, Weights


class NumpyEncoder:
    """`Encoder` by definition: all layers on whole patches (methods 7.9, 7.12)."""

    chunk = 4096

    def __init__(self, weights: Weights) -> None:
        self._layers, self._side = weights.encoder, 1 << weights.lookahead

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Encode, see `Encoder`."""
        return run_layers(self._layers, joined_blocks(blocks[rows], self._side).reshape(len(rows), -1))


def joined_blocks(blocks: np.ndarray, side: int) -> np.ndarray:
    """Patches (C, 2 s, 2 s, 2 s, 5), order z, y, x, channel, of the eight blocks around each of C corners."""
    eight = blocks.reshape(-1, 2, 2, 2, *(side,) * 3, CHANNELS)  # octant and cell of z, y, x; channel
    return eight.transpose(0, 1, 4, 2, 5, 3, 6, 7).reshape(-1, *(2 * side,) * 3, CHANNELS)


def decode(
    weights: Weights, codes: np.ndarray, direction: np.ndarray, up: np.ndarray, ratio: np.ndarray, *, clip: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Predicted coverage (N,) and luminance (N,), float32, of N pixels.

    codes: (N, 10) interpolated codes. direction, up: (N, 3) unit vectors in octree axes (methods 7.14). ratio: (N,)
    pixel-voxel ratio. clip: to [0, 1], as at inference; the range in training is [-1, 2].
    """
    outputs = sigmoid_output(run_layers(weights.decoder, ray_inputs(codes, direction, up, ratio)))
    coverage, luminance = (np.clip(outputs, 0, 1) if clip else outputs).T
    return coverage, luminance


def ray_inputs(codes: np.ndarray, direction: np.ndarray, up: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Inputs (N, 42) float32 of code and ray."""
    harmonics = real_harmonics(direction)
    modulated = codes[:, :MODULATED] * harmonics[:, :MODULATED]
    inputs = [modulated, codes[:, MODULATED:], direction, up, ratio[:, None], harmonics]
    return np.concatenate(inputs, axis=1).astype(np.float32)


def run_layers(layers: Sequence[Layer], values: np.ndarray) -> np.ndarray:
    """Last layer's values (N, outputs) for inputs (N, inputs)."""
    *hidden, (matrix, bias) = layers
    for weight, offset in hidden:
        values = np.maximum(values @ weight.T + offset, 0)
    return np.asarray(values @ matrix.T + bias)


def sigmoid_output(logits: np.ndarray) -> np.ndarray:
    """Outputs in [-1, 2] of logits, which are clipped to avoid overflow warnings."""
    return np.asarray(OUTPUT_LOW + OUTPUT_RANGE / (1 + np.exp(-np.clip(logits, -80, 80))))


@dataclass(frozen=True, eq=False)
class MixtureInputs:
    """Inputs of the mixture's decoder for N pixels, all float32.

    codes: (N, 10) interpolated codes. corner_codes: (N, 8, 4) first numbers of the codes of the hit voxel's corners, x
    fastest. direction, up: (N, 3) unit vectors in octree axes. ratio: (N,) pixel-voxel ratio. view: (N, 9) direction,
    entry point from -1 to 1, and up in the ray frame. covered: (N, 64) share of the pixel that each child and each
    outer cell covers alone, 0 for missing ones. luminances: (N, 65) of these cells, then of the voxel.
    """

    codes: np.ndarray
    corner_codes: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray
    view: np.ndarray
    covered: np.ndarray
    luminances: np.ndarray


def decode_mixture(weights: Weights, given: MixtureInputs) -> tuple[np.ndarray, np.ndarray]:
    """Predicted coverage (N,) in [0, 1] and luminance (N,), float32, of N pixels by a mixture."""
    rays = ray_inputs(given.codes, given.direction, given.up, given.ratio)
    corner_codes = given.corner_codes.reshape(len(rays), CORNERS * SIDE_BY_SIDE)
    outputs = run_layers(weights.decoder, np.concatenate([rays, corner_codes, given.view, given.covered], axis=1))
    luminance = (mixture_shares(outputs[:, 1:], given.covered) * given.luminances).sum(axis=1)
    return np.clip(sigmoid_output(outputs[:, 0]), 0, 1), luminance


def mixture_shares(logits: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Shares (N, 65) of luminances, with a sum of 1: e^logit (N, 65) times `covered` (N, 64).

    The voxel's own luminance is last, and counts as covering the whole pixel.
    """
    weights = np.concatenate([covered, np.ones((len(covered), 1), np.float32)], axis=1)
    assert weights.shape[1] == COVERING + 1
    largest = np.where(weights > 0, logits, -np.inf).max(axis=1, keepdims=True)
    shares = weights * np.exp(np.minimum(logits - largest, 0))
    return np.asarray(shares / shares.sum(axis=1, keepdims=True), np.float32)
