# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoders that convolve (`encoders.py`) on torch, for training and for the codes of octrees."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from .encoders import CHANNELS, MAXIMUM, Branch, Stage
from .torch_precision import float32_products
from .weights import Weights

TorchLayer = tuple[Tensor, Tensor]
"""Kernels or matrix, and bias, as `Layer` has them."""

_CHUNKS = {"cpu": 512, "cuda": 8192}  # corners at once


class TorchConvolutions:
    """`Encoder` on a torch device, in float32 whatever torch is set to; `encode_tensors` as `TorchEncoder` has it."""

    def __init__(self, weights: Weights, device: str = "cpu") -> None:
        """Copy the encoder's layers to `device`; raises RuntimeError or AssertionError where torch has no such one."""
        self.device = torch.device(device)
        self.chunk = _CHUNKS[self.device.type]
        self._stages = weights.encoder_kind.stages(weights.lookahead)
        self._layers = [tuple(self._tensor(array) for array in layer) for layer in weights.encoder]

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32, see `Encoder`."""
        codes: np.ndarray = self.encode_tensors(self._tensor(blocks), self._tensor(rows).long()).cpu().numpy()
        return codes

    @torch.inference_mode()
    def encode_tensors(self, blocks: Tensor, rows: Tensor) -> Tensor:
        """Codes (C, 10) float32 of corners with blocks (U, B) float32 and rows (C, 8) int64, all on the device."""
        with float32_products(self.device):
            return convolved_codes(self._stages, self._layers, patch_cells(blocks[rows]))  # type: ignore[arg-type]

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)


def patch_cells(eight: Tensor) -> Tensor:
    """Cells (C, 5, 2 s, 2 s, 2 s), channel, z, y, x, of the eight blocks (C, 8, B) around corners, x fastest."""
    side = round((eight.shape[2] // CHANNELS) ** (1 / 3))
    parts = eight.view(-1, 2, 2, 2, side, side, side, CHANNELS)  # octant and cell of z, y, x; channel
    return parts.permute(0, 7, 1, 4, 2, 5, 3, 6).reshape(-1, CHANNELS, *(2 * side,) * 3)


def convolved_codes(
    stages: Iterable[Stage], layers: Iterable[TorchLayer], cells: Tensor, dtype: torch.dtype = torch.float32
) -> Tensor:
    """Codes (C, 10) float32 of patches (C, 5, S, S, S).

    All products but the last layer's are in `dtype`.
    """
    left = iter(layers)
    cells = cells.to(dtype, memory_format=torch.channels_last_3d)
    for stage in stages:
        cells = functional.relu(torch.cat([_branch(branch, left, cells) for branch in stage], dim=1))
    (hidden, hidden_bias), (last, last_bias) = left
    values = functional.relu(functional.linear(cells.flatten(1), hidden.to(dtype), hidden_bias.to(dtype)))
    return functional.linear(values.float(), last, last_bias)


def _branch(branch: Branch, layers: Iterator[TorchLayer], cells: Tensor) -> Tensor:
    kernels, bias = (array.to(cells.dtype) for array in next(layers))
    values = functional.conv3d(cells, kernels, bias, stride=branch.stride, padding=branch.side // 2)
    if not branch.pool:
        return values
    if branch.pool == MAXIMUM:
        return functional.max_pool3d(values, 3, stride=2, padding=1)
    # On the CPU torch has no such means of bfloat16.
    return functional.avg_pool3d(values.float(), 3, stride=2, padding=1).to(values.dtype)
