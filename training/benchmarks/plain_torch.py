# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain path of the encoder on torch, to measure against: whole patches through four linear layers."""

from __future__ import annotations

import numpy as np
import torch

from ...patchnet_addon.network.octants import octant_matrices
from ...patchnet_addon.network.weights import Weights


class PlainTorchEncoder:
    """`Encoder` on torch's CPU that multiplies all of every patch, empty octants too."""

    chunk = 4096

    def __init__(self, weights: Weights) -> None:
        matrix, bias = weights.encoder[0]
        octants = octant_matrices(matrix)
        # A patch as its eight blocks, one after the other: (8 B, 256).
        first = octants.reshape(len(octants), 8, -1).transpose(1, 0, 2).reshape(-1, len(bias))
        layers = [(first, bias), *((matrix.T, bias) for matrix, bias in weights.encoder[1:])]
        self._layers = [tuple(torch.from_numpy(np.ascontiguousarray(array)) for array in layer) for layer in layers]

    @torch.inference_mode()
    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32, see `Encoder`; the patches are put together here, within the time."""
        values = torch.from_numpy(blocks)[torch.from_numpy(np.ascontiguousarray(rows)).reshape(-1)]
        values = values.reshape(len(rows), -1)
        for index, (matrix, bias) in enumerate(self._layers):
            values = torch.addmm(bias, values.relu_() if index else values, matrix)
        return values.numpy()
