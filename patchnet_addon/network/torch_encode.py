# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's encoder on torch, on the CPU or a GPU; the scheme is that of `encode.py`.

Another Python may run this file on its own: it imports nothing of the package but `octants.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch.nn import functional

from .octants import octant_matrices

if TYPE_CHECKING:
    from .weights import Weights


class TorchEncoder:
    """`Encoder` on a torch device, for example "cpu" or "cuda"."""

    def __init__(self, weights: Weights, device: str = "cpu") -> None:
        self._device = torch.device(device)
        self.chunk = 4096 if self._device.type == "cpu" else 65536
        matrix, bias = weights.encoder[0]
        self._octants = self._tensor(octant_matrices(matrix))
        self._bias = self._tensor(bias)
        self._layers = [(self._tensor(matrix.T), self._tensor(bias)) for matrix, bias in weights.encoder[1:]]

    @torch.inference_mode()
    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32, see `Encoder`."""
        products = (self._tensor(blocks) @ self._octants).view(-1, len(self._bias))  # (8 U, 256)
        bags = rows * 8 + np.arange(8)
        bags[rows == 0] = 0  # block 0 is empty, and padding is not read
        values = functional.embedding_bag(self._tensor(bags), products, mode="sum", padding_idx=0)
        values += self._bias
        for matrix, bias in self._layers:
            values = torch.addmm(bias, values.relu_(), matrix)
        return values.cpu().numpy()

    def _tensor(self, array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self._device)
