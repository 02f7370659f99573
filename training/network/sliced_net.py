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

from ...patchnet_addon.network.devices import CPU
from ...patchnet_addon.network.torch_convolutions import patch_cells
from ...patchnet_addon.network.torch_model import MixturePlace, PatchNet
from ...patchnet_addon.network.weights import Weights
from ..data.padded_batch import PaddedBatch
from ..data.tensor_batch import TensorBatch
from .corner_layer import SLICES, BlockPairs, corner_sums, from_slices, to_slices, with_luminance
from .cpu_decoder import CpuDecoder
from .cpu_encoder import CpuEncoder


class SlicedNet(nn.Module):
    """Network of some weights, which `to_weights` gives back."""

    def __init__(self, weights: Weights) -> None:
        super().__init__()
        self.net = PatchNet.from_weights(weights)
        self.slices: nn.Parameter | None = None
        self._shape_alone = weights.kind.mixes
        if weights.encoder_kind.convolves:
            return
        first = self._encoder()[0]
        slices = to_slices(first.weight.detach(), shape_alone=self._shape_alone)  # (8, B, out), B as in `Batch`
        self.slices = nn.Parameter(slices.clone())
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

        The batch lies on the network's device; on a GPU it is a `PaddedBatch`.
        """
        voxels, views = batch.ratio.shape
        eight = self._codes(batch, dtype).view(voxels, 8, -1)
        found = self._decoded_on_cpu(eight, batch) if eight.device.type == CPU else self._decoded(eight, batch)
        return found.view(voxels, views, 2)

    def _decoded_on_cpu(self, eight: Tensor, batch: TensorBatch) -> Tensor:
        """The same as `_decoded`, by kernels."""
        layers = [part for layer in self.net.decoder for part in (layer.weight, layer.bias)]
        return CpuDecoder.apply(eight, batch, *layers)  # type: ignore[no-any-return]

    def _decoded(self, eight: Tensor, batch: TensorBatch) -> Tensor:
        """Coverage and luminance (V R, 2) of codes (V, 8, 10) of the voxels' corners."""
        codes = torch.bmm(corner_shares(batch.entry), eight).flatten(0, 1)  # (V R, 10)
        rays = *(part.flatten(0, 1) for part in (batch.direction, batch.up)), batch.ratio.reshape(-1)
        if batch.nearby is None:
            return self.net.decode(codes, *rays)
        corner_codes = eight[:, None].expand(-1, batch.ratio.shape[1], -1, -1).flatten(0, 1)  # (V R, 8, 10)
        near = batch.nearby.view, batch.nearby.covered, batch.nearby.luminances
        place = MixturePlace(corner_codes, *(part.flatten(0, 1) for part in near))
        return self.net.decode_mixture(codes, place, *rays)

    def _codes(self, batch: TensorBatch, dtype: torch.dtype) -> Tensor:
        """Codes (8 V, 10) float32 of the voxels' corners, by products in `dtype`."""
        if self.slices is None:
            return self._encode_convolving(batch, dtype)
        codes: Tensor = self._encoder()[-1](self._hidden(batch, dtype))
        return codes

    def _hidden(self, batch: TensorBatch, dtype: torch.dtype) -> Tensor:
        """Values (8 V, 256) float32 that the encoder's last layer is given, by products in `dtype`."""
        first, *middle, _ = self._encoder()
        corners = 8 * len(batch.ratio)
        pairs = batch.pair_block, batch.pair_corner, corners
        if not isinstance(batch, PaddedBatch):
            layers = [part for layer in middle for part in (layer.weight, layer.bias)]
            parameters = self.slices, first.bias, *layers
            return CpuEncoder.apply(dtype, _pairs(batch), *parameters)  # type: ignore[no-any-return]
        assert self.slices is not None
        hidden = torch.relu(corner_sums(self.slices, batch.blocks.to(dtype), *pairs) + first.bias)
        for layer in middle:
            hidden = hidden.to(dtype)
            hidden = torch.relu(functional.linear(hidden, layer.weight.to(dtype), layer.bias.to(dtype)))
        return hidden.float()

    def _encode_convolving(self, batch: TensorBatch, dtype: torch.dtype) -> Tensor:
        """Codes (8 V, 10) of the corners by convolutions of their whole patches."""
        blocks = (with_luminance(batch.blocks) if self._shape_alone else batch.blocks).to(dtype)
        corners = 8 * len(batch.ratio)
        eight = torch.zeros(corners + 1, SLICES, blocks.shape[1], dtype=dtype, device=blocks.device)
        if isinstance(batch, PaddedBatch):  # the last row is of pairs of nothing
            eight[batch.pair_corner, torch.arange(SLICES, device=blocks.device)[:, None]] = blocks[batch.pair_block]
        else:
            for number, (first, last) in enumerate(itertools.pairwise(batch.slice_start)):
                eight[batch.pair_corner[first:last], number] = blocks[batch.pair_block[first:last]]
        return self.net.convolve(patch_cells(eight[:corners]), dtype)

    def to_weights(self, metadata: dict[str, Any] | None = None) -> Weights:
        """Copy of the parameters as plain arrays."""
        if self.slices is not None:
            with torch.no_grad():
                self._encoder()[0].weight.copy_(from_slices(self.slices, shape_alone=self._shape_alone))
        return self.net.to_weights(metadata)


def _pairs(batch: TensorBatch) -> BlockPairs:
    """Pairs of blocks and corners of a batch on the CPU."""
    return BlockPairs(batch.blocks, batch.slice_start, batch.pair_block, batch.pair_corner, 8 * len(batch.ratio))


def corner_shares(entry: Tensor) -> Tensor:
    """Trilinear shares (V, R, 8) of a voxel's corners, x fastest, at points (V, R, 3) in [0, 1]^3."""
    x, y, z = torch.stack([1 - entry, entry], dim=-1).unbind(2)  # each (V, R, 2)
    return (z[..., :, None, None] * y[..., None, :, None] * x[..., None, None, :]).flatten(2)
