# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolving encoders in NumPy: the reference of `training/network/patchnet.py`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from patchnet.patchnet_addon.network.weights import Layer, Weights
from patchnet.tests.references.networks import joined_blocks
from patchnet.training.encoders import MAXIMUM, Branch, ConvolvingKind


class NumpyConvolutions:
    """`Encoder` of any architecture that convolves, window by window from the definition."""

    chunk = 256

    def __init__(self, weights: Weights) -> None:
        self._weights = weights

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Encode as `Encoder` says."""
        weights = self._weights
        assert isinstance(weights.encoder_kind, ConvolvingKind)
        cells = np.moveaxis(joined_blocks(blocks[rows], 1 << weights.lookahead), -1, 1)
        layers = iter(weights.encoder)
        for stage in weights.encoder_kind.stages(weights.lookahead):
            cells = np.maximum(np.concatenate([_branch(branch, layers, cells) for branch in stage], axis=1), 0)
        (hidden, hidden_bias), (last, last_bias) = layers
        values = np.maximum(cells.reshape(len(cells), hidden.shape[1]) @ hidden.T + hidden_bias, 0)
        codes: np.ndarray = values @ last.T + last_bias
        return codes


def _branch(branch: Branch, layers: Iterator[Layer], cells: np.ndarray) -> np.ndarray:
    kernels, bias = next(layers)
    values = np.einsum("fkzyx,ckdhwzyx->cfdhw", kernels, _windows(cells, branch.side, branch.stride, 0.0))
    values = values + bias[:, None, None, None]
    if not branch.pool:
        return values
    largest = branch.pool == MAXIMUM
    windows = _windows(values, 3, 2, -np.inf if largest else 0.0)
    return np.asarray(windows.max(axis=(-3, -2, -1)) if largest else windows.mean(axis=(-3, -2, -1)))


def _windows(cells: np.ndarray, side: int, stride: int, around: float) -> np.ndarray:
    """Windows (C, K, n, n, n, side, side, side) around every `stride`-th cell of (C, K, N, N, N)."""
    margin = (side // 2, side // 2)
    padded = np.pad(cells, ((0, 0), (0, 0), margin, margin, margin), constant_values=around)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side,) * 3, axis=(2, 3, 4))
    return windows[:, :, ::stride, ::stride, ::stride]
