# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of the luminance mixture in NumPy: the reference of the compiled one (methods 11.1)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .decode import BLOCK, fill_ray_inputs, run_decoder, sigmoid_output
from .kinds import CORNERS, COVERING, MIXTURE, RAY_INPUTS, SIDE_BY_SIDE, VIEW
from .weights import Weights

VIEWS = RAY_INPUTS + CORNERS * SIDE_BY_SIDE  # rows of inputs: the view in the ray's frame,
COVERED = VIEWS + VIEW  # and what children and outer cells cover


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
