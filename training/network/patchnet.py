# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet as a torch module for training, on the CPU and on GPUs; the engine's kernels run the same network."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ...patchnet_addon.network.encoders import CHANNELS, LUMINANCE, EncoderKind
from ...patchnet_addon.network.harmonics import harmonic_terms
from ...patchnet_addon.network.kinds import OUTPUT_LOW, OUTPUT_RANGE, SIDE_BY_SIDE
from ...patchnet_addon.network.weights import MODULATED, Weights
from ..data.batches import Batch
from ..data.nearby import Nearby
from ..encoders import MAXIMUM, Branch, ConvolvingKind

_SHAPE = [channel for channel in range(CHANNELS) if channel != LUMINANCE]  # channels of a cell's shape
_FIRST = "encoder.0.weight"


class PatchNet(nn.Module):
    """Encoder of patches, trilinear interpolation of the eight corners' codes, decoder (methods 7.9 to 7.15, 11.1).

    A patch is eight blocks of cells, octants x fastest, as in `Batch`: the columns of the first matrix are in
    that order. A luminance mixture encodes shape only: its blocks and first matrix have no luminance.
    """

    def __init__(self, weights: Weights) -> None:
        """Network with a copy of `weights`; `to_weights` is the inverse."""
        super().__init__()
        self.lookahead, self.kind, self.encoder_kind = weights.lookahead, weights.kind, weights.encoder_kind
        self.encoder = nn.ModuleList(_encoder_layers(self.encoder_kind, self.lookahead))
        self.decoder = nn.ModuleList(nn.Linear(*sizes) for sizes in itertools.pairwise(self.kind.decoder))
        arrays = weights.arrays()
        if not isinstance(self.encoder_kind, ConvolvingKind):
            columns = self._columns()
            self.encoder[0] = nn.Linear(len(columns), self.encoder_kind.width)
            arrays[_FIRST] = arrays[_FIRST][:, columns]
        self.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in arrays.items()})

    def to_weights(self, metadata: dict[str, Any] | None = None) -> Weights:
        """Copy of the parameters as plain arrays."""
        arrays = {name: value.detach().cpu().numpy().copy() for name, value in self.state_dict().items()}
        if not isinstance(self.encoder_kind, ConvolvingKind):
            (rows, _), own = self.encoder_kind.shapes(self.lookahead)[0], arrays[_FIRST]
            arrays[_FIRST] = np.zeros((rows, self.encoder_kind.sizes(self.lookahead)[0]), np.float32)
            arrays[_FIRST][:, self._columns()] = own
        return Weights.from_arrays(arrays, metadata, self.lookahead, self.kind, self.encoder_kind)

    def _columns(self) -> np.ndarray:
        """Order that turns the first matrix's columns, by z, y, x, channel of a patch, into the order of blocks."""
        side = 1 << self.lookahead
        columns = np.arange(8 * side**3 * CHANNELS).reshape(2, side, 2, side, 2, side, CHANNELS)
        blocks = columns.transpose(0, 2, 4, 1, 3, 5, 6)  # octant and cell of z, y, x; channel
        return (blocks[..., _SHAPE] if self.kind.mixes else blocks).ravel()

    @property
    def device(self) -> torch.device:
        """Device of its parameters."""
        return next(self.parameters()).device

    def forward(self, batch: Batch, dtype: torch.dtype = torch.float32) -> Tensor:
        """Coverage and luminance (V, R, 2), see `decode`; codes and decoder are float32 for any `dtype` of the encoder.
        The batch is on the network's device.
        """
        patches = batch.blocks.to(dtype)[batch.rows]  # (8 V, 8, B)
        corner_codes = self.encode(patches, dtype).view(len(batch.ratio), 8, -1)
        codes = interpolate(corner_codes, batch.entry)
        if batch.nearby is None:
            return self.decode(codes, batch.direction, batch.up, batch.ratio)
        apart = corner_codes[:, None].expand(-1, batch.ratio.shape[1], -1, -1)
        return self.decode_mixture(codes, apart, batch.nearby, batch.direction, batch.up, batch.ratio)

    def encode(self, patches: Tensor, dtype: torch.dtype = torch.float32) -> Tensor:
        """Codes (C, 10) of patches (C, 8, B); products run in `dtype`, those of the last layer in float32.

        Patches of a mixture may have luminance, too, if its encoder convolves: its weights of it are 0.
        """
        with torch.autocast(patches.device.type, torch.bfloat16, enabled=dtype == torch.bfloat16):
            values = self._hidden(patches)
        return self.encoder[-1](values.float())

    def _hidden(self, patches: Tensor) -> Tensor:
        """Input (C, width) of the encoder's last layer."""
        if not isinstance(self.encoder_kind, ConvolvingKind):
            return torch.relu(_run_layers(self.encoder[:-1], patches.flatten(1)))
        *layers, hidden = self.encoder[:-1]
        cells = _cells(patches if patches.shape[2] == CHANNELS * 8**self.lookahead else _with_luminance(patches))
        cells = cells.contiguous(memory_format=torch.channels_last_3d)
        left = iter(layers)
        for stage in self.encoder_kind.stages(self.lookahead):
            cells = torch.relu(torch.cat([_branch(branch, next(left), cells) for branch in stage], dim=1))
        return torch.relu(hidden(cells.flatten(1)))

    def decode(self, codes: Tensor, direction: Tensor, up: Tensor, ratio: Tensor) -> Tensor:
        """Coverage and luminance (..., 2) in [-1, 2] for codes (..., 10), unit vectors (..., 3) and ratios (...)."""
        return _bounded(_run_layers(self.decoder, _ray_inputs(codes, direction, up, ratio)))

    def decode_mixture(
        self, codes: Tensor, corner_codes: Tensor, near: Nearby, direction: Tensor, up: Tensor, ratio: Tensor
    ) -> Tensor:
        """Coverage in [-1, 2] and luminance (..., 2), see `decode`, of a luminance mixture (methods 11.1).

        corner_codes: (..., 8, 10), of which the first four numbers are used.
        """
        rays, apart = _ray_inputs(codes, direction, up, ratio), corner_codes[..., :SIDE_BY_SIDE].flatten(-2)
        outputs = _run_layers(self.decoder, torch.cat([rays, apart, near.view, near.covered], dim=-1))
        covered = torch.cat([near.covered, torch.ones_like(near.covered[..., :1])], dim=-1)
        logits = outputs[..., 1:].masked_fill(covered <= 0, -torch.inf)
        shares = covered * torch.exp(logits - logits.amax(dim=-1, keepdim=True))
        shares = shares / shares.sum(dim=-1, keepdim=True)
        return torch.stack([_bounded(outputs[..., 0]), (shares * near.luminances).sum(-1)], dim=-1)


def _cells(patches: Tensor) -> Tensor:
    """Cells (C, 5, 2 s, 2 s, 2 s), channel, z, y, x, of the eight blocks (C, 8, B) of patches, octants x fastest."""
    side = round((patches.shape[2] // CHANNELS) ** (1 / 3))
    parts = patches.view(-1, 2, 2, 2, side, side, side, CHANNELS)  # octant and cell of z, y, x; channel
    return parts.permute(0, 7, 1, 4, 2, 5, 3, 6).reshape(-1, CHANNELS, *(2 * side,) * 3)


def _branch(branch: Branch, convolution: nn.Module, cells: Tensor) -> Tensor:
    values: Tensor = convolution(cells)
    if not branch.pool:
        return values
    if branch.pool == MAXIMUM:
        return functional.max_pool3d(values, 3, stride=2, padding=1)
    # torch does not implement this pooling of bfloat16 on the CPU.
    return functional.avg_pool3d(values.float(), 3, stride=2, padding=1).to(values.dtype)


def interpolate(corner_codes: Tensor, entry: Tensor) -> Tensor:
    """Codes (V, R, 10) at points (V, R, 3) in [0, 1]^3, trilinear from those of corners (V, 8, 10), x fastest."""
    x, y, z = torch.stack([1 - entry, entry], dim=-1).unbind(2)  # each (V, R, 2)
    shares = (z[..., :, None, None] * y[..., None, :, None] * x[..., None, None, :]).flatten(2)
    return torch.bmm(shares, corner_codes)


def _ray_inputs(codes: Tensor, direction: Tensor, up: Tensor, ratio: Tensor) -> Tensor:
    """Decoder inputs (..., 42) of code and ray."""
    x, y, z = direction.unbind(-1)
    harmonics = torch.stack(harmonic_terms(x, y, z), dim=-1)  # (..., 25)
    modulated = codes[..., :MODULATED] * harmonics[..., :MODULATED]
    return torch.cat([modulated, codes[..., MODULATED:], direction, up, ratio[..., None], harmonics], dim=-1)


def _bounded(outputs: Tensor) -> Tensor:
    return OUTPUT_LOW + OUTPUT_RANGE * torch.sigmoid(outputs)


def _with_luminance(blocks: Tensor) -> Tensor:
    """Blocks (..., 5 n) with luminance 0 from blocks (..., 4 n) without luminance."""
    cells = blocks.unflatten(-1, (-1, len(_SHAPE)))
    result = cells.new_zeros(*cells.shape[:-1], CHANNELS)
    result[..., _SHAPE] = cells
    return result.flatten(-2)


def _encoder_layers(encoder: EncoderKind, lookahead: int) -> list[nn.Module]:
    """Layers without values; convolutions have zero padding."""
    shapes = encoder.shapes(lookahead)
    stages = encoder.stages(lookahead) if isinstance(encoder, ConvolvingKind) else ()
    branches = [branch for stage in stages for branch in stage]
    layers: list[nn.Module] = [
        nn.Conv3d(shape[1], shape[0], branch.side, branch.stride, branch.side // 2)
        for branch, shape in zip(branches, shapes, strict=False)
    ]
    return layers + [nn.Linear(shape[1], shape[0]) for shape in shapes[len(branches) :]]


def _run_layers(layers: nn.ModuleList, values: Tensor) -> Tensor:
    for layer in layers[:-1]:
        values = torch.relu(layer(values))
    return layers[-1](values)
