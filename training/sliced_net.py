# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet as it is trained: the first matrix kept as one slice per octant, the form that `corner_layer.py` needs.

Encoders that convolve have no such matrix: they see the corners' whole patches.
"""

from __future__ import annotations

import itertools
from typing import Any

import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from ..patchnet_addon.network.encoders import CHANNELS, LUMINANCE
from ..patchnet_addon.network.torch_convolutions import patch_cells
from ..patchnet_addon.network.torch_model import MixturePlace, PatchNet
from ..patchnet_addon.network.weights import Weights
from .corner_layer import SLICES, CornerLayer, from_slices, to_slices
from .tensor_batch import TensorBatch


class SlicedNet(nn.Module):
    """Network of some weights, which `to_weights` gives back."""

    def __init__(self, weights: Weights) -> None:
        super().__init__()
        self.net = PatchNet.from_weights(weights)
        self.slices: nn.Parameter | None = None
        if weights.encoder_kind.convolves:
            return
        first = self._encoder()[0]
        self.slices = nn.Parameter(
            to_slices(first.weight.detach()).clone()
        )  # (8, B, 256), B = 320 for a look-ahead of two levels
        first.weight.requires_grad_(False)  # stands in `slices` until `to_weights`

    def _encoder(self) -> list[nn.Linear]:
        return list(self.net.encoder)  # type: ignore[arg-type]

    @property
    def device(self) -> torch.device:
        """Where its parameters lie."""
        return next(self.parameters()).device

    def trained(self) -> list[nn.Parameter]:
        """Parameters that are learned."""
        return [parameter for parameter in self.parameters() if parameter.requires_grad]

    def forward(self, batch: TensorBatch, dtype: torch.dtype) -> Tensor:
        """Coverage and luminance (V, R, 2) in [-1, 2]; codes and decoder in float32 whatever the encoder's `dtype`.

        The batch lies on the network's device.
        """
        voxels, views = batch.ratio.shape
        encode = self._encode_linear if self.slices is not None else self._encode_convolving
        eight = encode(batch, dtype).view(voxels, 8, -1)
        codes = torch.bmm(corner_shares(batch.entry), eight).flatten(0, 1)  # (V R, 10)
        rays = *(part.flatten(0, 1) for part in (batch.direction, batch.up)), batch.ratio.reshape(-1)
        if batch.nearby is None:
            return self.net.decode(codes, *rays).view(voxels, views, 2)
        corner_codes = eight[:, None].expand(-1, views, -1, -1).flatten(0, 1)  # (V R, 8, 10)
        near = batch.nearby.view, batch.nearby.covered, batch.nearby.luminances
        place = MixturePlace(corner_codes, *(part.flatten(0, 1) for part in near))
        return self.net.decode_mixture(codes, place, *rays).view(voxels, views, 2)

    def _encode_linear(self, batch: TensorBatch, dtype: torch.dtype) -> Tensor:
        """Codes (8 V, 10) of the corners by linear layers, of which the first sees occupied blocks alone."""
        first, *middle, last = self._encoder()
        blocks = self._seen(batch.blocks).to(dtype)
        pairs = batch.pair_block, batch.pair_corner
        hidden = CornerLayer.apply(self.slices, blocks, batch.slice_start, *pairs, 8 * len(batch.ratio))
        hidden = torch.relu(hidden + first.bias.to(dtype))
        for layer in middle:
            hidden = torch.relu(functional.linear(hidden, layer.weight.to(dtype), layer.bias.to(dtype)))
        codes: Tensor = last(hidden.float())
        return codes

    def _encode_convolving(self, batch: TensorBatch, dtype: torch.dtype) -> Tensor:
        """Codes (8 V, 10) of the corners by convolutions of their whole patches."""
        blocks = self._seen(batch.blocks).to(dtype)
        eight = torch.zeros(8 * len(batch.ratio), SLICES, blocks.shape[1], dtype=dtype, device=blocks.device)
        for number, (first, last) in enumerate(itertools.pairwise(batch.slice_start)):
            eight[batch.pair_corner[first:last], number] = blocks[batch.pair_block[first:last]]
        return self.net.convolve(patch_cells(eight), dtype)

    def _seen(self, blocks: Tensor) -> Tensor:
        """Blocks (M, B) without luminance for a network that sees shape alone."""
        if not self.net.kind.mixes:
            return blocks
        cells = blocks.view(len(blocks), -1, CHANNELS).clone()
        cells[:, :, LUMINANCE] = 0
        return cells.flatten(1)

    def to_weights(self, metadata: dict[str, Any] | None = None) -> Weights:
        """Copy of the parameters as plain arrays."""
        if self.slices is not None:
            with torch.no_grad():
                self._encoder()[0].weight.copy_(from_slices(self.slices))
        return self.net.to_weights(metadata)


def corner_shares(entry: Tensor) -> Tensor:
    """Trilinear shares (V, R, 8) of a voxel's corners, x fastest, at points (V, R, 3) in [0, 1]^3."""
    x, y, z = torch.stack([1 - entry, entry], dim=-1).unbind(2)  # each (V, R, 2)
    return (z[..., :, None, None] * y[..., None, :, None] * x[..., None, None, :]).flatten(2)
