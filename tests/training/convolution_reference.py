# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoders that convolve, in NumPy: the Reference of `training/network/convolutions.py`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from patchnet.patchnet_addon.network.encoders import CHANNELS, patch_side
from patchnet.patchnet_addon.network.weights import Layer, Weights
from patchnet.training.encoders import MAXIMUM, Branch, ConvolvingKind

_OFFSETS = tuple(itertools.product(range(3), range(3), range(3)))  # of the cells in a window of 3x3x3


def corner_patches(blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Patches (C, 5, 2 s, 2 s, 2 s), channel, z, y, x, of blocks (U, B) and rows (C, 8), see `Encoder`."""
    side = round((blocks.shape[1] // CHANNELS) ** (1 / 3))
    eight = blocks[rows].reshape(-1, 2, 2, 2, side, side, side, CHANNELS)  # octant and cell of z, y, x; channel
    return eight.transpose(0, 7, 1, 4, 2, 5, 3, 6).reshape(-1, CHANNELS, *(2 * side,) * 3)


class NumpyConvolutions:
    """`Encoder` of any architecture that convolves, cell by cell of the kernels."""

    chunk = 256

    def __init__(self, weights: Weights) -> None:
        self._weights = weights

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Encode as `Encoder` says."""
        return convolve_reference(self._weights, corner_patches(blocks, rows))


def convolve_reference(weights: Weights, cells: np.ndarray) -> np.ndarray:
    """Codes (C, 10) float32 of patches (C, 5, S, S, S), S = `patch_side(lookahead)`."""
    assert cells.shape[1:] == (CHANNELS, *(patch_side(weights.lookahead),) * 3)
    assert isinstance(weights.encoder_kind, ConvolvingKind)
    layers = iter(weights.encoder)
    for stage in weights.encoder_kind.stages(weights.lookahead):
        cells = np.maximum(np.concatenate([_branch(branch, layers, cells) for branch in stage], axis=1), 0)
    (hidden, hidden_bias), (last, last_bias) = layers
    values = np.maximum(cells.reshape(len(cells), hidden.shape[1]) @ hidden.T + hidden_bias, 0)
    codes: np.ndarray = values @ last.T + last_bias
    return codes


def _branch(branch: Branch, layers: Iterator[Layer], cells: np.ndarray) -> np.ndarray:
    kernels, bias = next(layers)
    values = sum(
        np.einsum("fc,nczyx->nfzyx", kernels[..., z, y, x], window)
        for (z, y, x), window in _windows(cells, branch.side, branch.stride, 0.0)
    )
    result: np.ndarray = values + bias[:, None, None, None]
    if not branch.pool:
        return result
    if branch.pool == MAXIMUM:
        return np.max([window for _, window in _windows(result, 3, 2, -np.inf)], axis=0)
    return np.mean([window for _, window in _windows(result, 3, 2, 0.0)], axis=0)


def _windows(
    cells: np.ndarray, side: int, stride: int, around: float
) -> Iterator[tuple[tuple[int, int, int], np.ndarray]]:
    """Place in a window of `side` cells, and the cells (C, K, n, n, n) there of all windows."""
    margin, count = side // 2, cells.shape[-1]
    padded = np.pad(cells, ((0, 0), (0, 0), *((margin, margin),) * 3), constant_values=around)
    for offset in _OFFSETS if side == 3 else ((0, 0, 0),):
        first, second, third = offset
        z, y, x = (slice(start, start + count, stride) for start in offset)
        yield (first, second, third), padded[..., z, y, x]
