# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet as it is trained: the first matrix kept as one slice per octant, the form that `corner_layer.py` needs."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from ..patchnet_addon.network.torch_model import PatchNet
from ..patchnet_addon.network.weights import Weights
from .batches import Batch
from .corner_layer import CornerLayer, from_slices, to_slices


class SlicedNet(nn.Module):
    """The network of some weights, which `to_weights` gives back."""

    def __init__(self, weights: Weights) -> None:
        super().__init__()
        net = PatchNet.from_weights(weights)
        first, second, third, last = net.encoder
        self.slices = nn.Parameter(to_slices(first.weight.detach()).clone())  # (8, 320, 256)
        self.bias = nn.Parameter(first.bias.detach().clone())
        self.second, self.third, self.last, self.decoder = second, third, last, net.decoder

    def forward(self, batch: Batch, dtype: torch.dtype) -> Tensor:
        """Coverage and luminance (V, R, 2) in [-1, 2]; codes and decoder in float32 whatever the encoder's `dtype`."""
        voxels, views = batch.ratio.shape
        blocks = torch.from_numpy(batch.blocks).to(dtype)
        pairs = torch.from_numpy(batch.pair_block), torch.from_numpy(batch.pair_corner)
        hidden = CornerLayer.apply(self.slices, blocks, batch.slice_start.tolist(), *pairs, 8 * voxels)
        hidden = torch.relu(hidden + self.bias.to(dtype))
        for layer in (self.second, self.third):
            hidden = torch.relu(functional.linear(hidden, layer.weight.to(dtype), layer.bias.to(dtype)))
        codes = self.last(hidden.float()).view(voxels, 8, -1)
        codes = torch.bmm(corner_shares(torch.from_numpy(batch.entry)), codes)  # (V, R, 10)
        flat = [torch.from_numpy(array).reshape(voxels * views, -1) for array in (batch.direction, batch.up)]
        ratio = torch.from_numpy(batch.ratio).reshape(-1)
        return PatchNet.decode(self, codes.flatten(0, 1), *flat, ratio).view(voxels, views, 2)  # type: ignore[arg-type]

    def to_weights(self, metadata: dict[str, Any] | None = None) -> Weights:
        """Copy of the parameters as plain arrays."""
        net = PatchNet()
        layers = (net.encoder[1], self.second), (net.encoder[2], self.third), (net.encoder[3], self.last)
        with torch.no_grad():
            net.encoder[0].weight.copy_(from_slices(self.slices))
            net.encoder[0].bias.copy_(self.bias)
            for to, layer in layers:
                to.load_state_dict(layer.state_dict())
            net.decoder.load_state_dict(self.decoder.state_dict())
        return net.to_weights(metadata)


def corner_shares(entry: Tensor) -> Tensor:
    """Trilinear shares (V, R, 8) of a voxel's corners, x fastest, at points (V, R, 3) in [0, 1]^3."""
    x, y, z = torch.stack([1 - entry, entry], dim=-1).unbind(2)  # each (V, R, 2)
    return (z[..., :, None, None] * y[..., None, :, None] * x[..., None, None, :]).flatten(2)
