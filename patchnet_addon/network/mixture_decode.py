# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of the luminance mixture in NumPy: the reference of the compiled one (methods 11.1)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .decode import BLOCK, fill_ray_inputs, run_decoder, sigmoid_output
from .kinds import CHILDREN, CODE_SIZE, CORNERS, MIXTURE
from .weights import Weights

RAY_INPUTS = MIXTURE.decoder[0] - CHILDREN - 3 - CORNERS * CODE_SIZE  # those of the paper's decoder, which come first
ABSENT = np.float32(-1e4)  # the logit of a child that does not exist


@dataclass(frozen=True, eq=False)
class MixtureInputs:
    """What the decoder is given of N pixels, all float32.

    codes: (N, 10) interpolated codes. corner_codes: (N, 8, 10) those of the hit voxel's corners, x fastest. entry:
    (N, 3) point in the voxel, [0, 1]^3. direction, up: (N, 3) unit vectors in octree axes. ratio: (N,) pixel-voxel
    ratio. covered: (N, 8) coverage of the voxel's children along the ray, 0 for those that do not exist. luminances:
    (N, 17) of the children as seen along the ray, of the voxel, around its corners.
    """

    codes: np.ndarray
    corner_codes: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray
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
    corners_end = RAY_INPUTS + CORNERS * CODE_SIZE
    values[RAY_INPUTS:corners_end] = given.corner_codes.reshape(-1, CORNERS * CODE_SIZE).T
    values[corners_end : corners_end + 3] = 2 * given.entry.T - 1
    values[corners_end + 3 :] = given.covered.T
    outputs = run_decoder(weights, values)
    logits = outputs[1:].T.copy()  # (n, 17)
    logits[:, :CHILDREN][given.covered == 0] = ABSENT
    shares = np.exp(logits - logits.max(axis=1, keepdims=True))
    luminance = (shares * given.luminances).sum(axis=1) / shares.sum(axis=1)
    return np.clip(sigmoid_output(outputs[0]), 0, 1), luminance
