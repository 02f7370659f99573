# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder in matrix units as a function that autograd knows, so that it can be compared with its reference."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from patchnet.patchnet_addon.runtime.aligned_memory import aligned
from patchnet.training.network.corner_layer import SLICES, BlockPairs
from patchnet.training.network.flat_memory import MIDDLE, Sizes
from patchnet.training.network.matrix_units import SIDE
from patchnet.training.network.tiled_backward import differentiate_groups
from patchnet.training.network.tiled_forward import encode_groups
from patchnet.training.network.tiled_packing import PackedMatrices


class TiledEncoder(torch.autograd.Function):
    """Codes (corners, 10) of the occupied blocks of a batch, as `encode_reference` finds them."""

    @staticmethod
    def forward(ctx: Any, pairs: BlockPairs, slices: Tensor, *layers: Tensor) -> Tensor:
        blocks, starts, pair_block, pair_corner, corners = pairs
        bits = blocks.view(torch.int16).numpy().view(np.uint16)
        *biases, of_last = (each.detach().numpy() for each in layers[::2])
        last = layers[-2].detach().numpy()
        _, values, width = slices.shape
        copies = [slices.detach().clone(), *(each.detach().clone() for each in layers)]
        packed = PackedMatrices(copies, Sizes(values, width, len(last), np.zeros(5, np.int64))).current()
        lines = -(-corners // SIDE) * SIDE
        groups = np.empty(lines, np.int32), np.empty((lines, SLICES), np.int32), np.empty(lines // SIDE, np.int32)
        hidden = aligned((MIDDLE + 1, lines, width), np.uint16)
        codes = np.empty((corners, len(last)), np.float32)
        listed = np.array(starts), pair_block.numpy(), pair_corner.numpy()
        encode_groups(bits, listed, (packed, np.stack(biases), last, of_last), groups, hidden, codes)
        ctx.kept = bits, groups, hidden, packed, last
        return torch.from_numpy(codes)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        bits, groups, hidden, packed, last = ctx.kept
        layers, _, out = hidden.shape
        of_slices, of_last = torch.empty(SLICES, bits.shape[1], out), torch.empty(last.shape)
        of_middle, of_biases = [torch.empty(out, out) for _ in range(MIDDLE)], torch.zeros(layers, out)
        found = of_slices.numpy(), tuple(each.numpy() for each in of_middle), of_biases.numpy(), of_last.numpy()
        differentiate_groups(bits, groups, (packed, last), hidden, gradient.numpy(), found)
        of_layers = [
            part for pair in zip([*of_middle, of_last], [*of_biases[1:], gradient.sum(0)], strict=True) for part in pair
        ]
        return None, of_slices, of_biases[0], *of_layers
