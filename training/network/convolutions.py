# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoders that convolve (`training/encoders.py`) on torch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import torch
from torch import Tensor
from torch.nn import functional

from ...patchnet_addon.network.encoders import CHANNELS
from ..encoders import MAXIMUM, Branch, Stage

TorchLayer = tuple[Tensor, Tensor]
"""Kernels or matrix, and bias, as `Layer` has them."""


def convolved_values(stages: Iterable[Stage], layers: Iterable[TorchLayer], patches: Tensor) -> Tensor:
    """Values (C, hidden) that the last layer is given, of patches (C, 8, B), by all `layers` but that one."""
    left = iter(layers)
    cells = _cells(patches).contiguous(memory_format=torch.channels_last_3d)
    for stage in stages:
        cells = functional.relu(torch.cat([_branch(branch, left, cells) for branch in stage], dim=1))
    ((hidden, bias),) = left
    return functional.relu(functional.linear(cells.flatten(1), hidden, bias))


def _cells(patches: Tensor) -> Tensor:
    """Cells (C, 5, 2 s, 2 s, 2 s), channel, z, y, x, of the eight blocks (C, 8, B) of patches, octants x fastest."""
    side = round((patches.shape[2] // CHANNELS) ** (1 / 3))
    parts = patches.view(-1, 2, 2, 2, side, side, side, CHANNELS)  # octant and cell of z, y, x; channel
    return parts.permute(0, 7, 1, 4, 2, 5, 3, 6).reshape(-1, CHANNELS, *(2 * side,) * 3)


def _branch(branch: Branch, layers: Iterator[TorchLayer], cells: Tensor) -> Tensor:
    kernels, bias = next(layers)
    values = functional.conv3d(cells, kernels, bias, stride=branch.stride, padding=branch.side // 2)
    if not branch.pool:
        return values
    if branch.pool == MAXIMUM:
        return functional.max_pool3d(values, 3, stride=2, padding=1)
    # On the CPU torch has no such means of bfloat16.
    return functional.avg_pool3d(values.float(), 3, stride=2, padding=1).to(values.dtype)
