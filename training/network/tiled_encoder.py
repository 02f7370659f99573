# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder of a batch in the processor's matrix units, forward and backward, by one kernel each.

What `CpuEncoder` and the last layer after it do by torch's products of bfloat16, which read and write all values of a
layer once more for each step in between. Here 32 corners go through all layers while what they are lies in the
processor's nearest caches, and biases, ReLUs and rounding are done where the sums of a product are. Corners are put in
the order of the octants in which they have blocks: then the 32 of a group mostly have them in the same ones, and the
others are left out.

Products of bfloat16, all sums in float32, what a layer hands on rounded to bfloat16 once. Codes are products of float32
with that: a float32 is three numbers of bfloat16 that add up to it. The kernels are serial, since several threads learn
from a part of a step each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.runtime.aligned_memory import aligned
from .corner_layer import SLICES, BlockPairs
from .matrix_units import SIDE, matrix_units_usable
from .tiled_backward import differentiate_groups
from .tiled_forward import encode_groups


def takes(dtype: torch.dtype, values: int) -> bool:
    """Whether `TiledEncoder` can multiply blocks of so many values in this type here."""
    return dtype == torch.bfloat16 and values % SIDE == 0 and matrix_units_usable()


class TiledEncoder(torch.autograd.Function):
    """Codes (corners, 10) float32 of the occupied blocks of a batch; the gradient goes to the parameters."""

    @staticmethod
    def forward(ctx: Any, pairs: BlockPairs, slices: Tensor, *layers: Tensor) -> Tensor:
        """Results of slices (8, B, out) and `layers`: a bias (out,), then matrices and biases in turn, float32.

        The last matrix (10, out) is multiplied in float32, those before, (out, out), and the slices in bfloat16. B and
        `out` are multiples of 32.
        """
        blocks, starts, pair_block, pair_corner, corners = pairs
        bits = blocks.to(torch.bfloat16).view(torch.int16).numpy().view(np.uint16)
        *biases, of_last = (each.detach().numpy() for each in layers[::2])
        *middle, last = (each.detach().numpy() for each in layers[1::2])
        lines = -(-corners // SIDE) * SIDE
        groups = np.empty(lines, np.int32), np.empty((lines, SLICES), np.int32), np.empty(lines // SIDE, np.int32)
        hidden = aligned((len(biases), lines, slices.shape[2]), np.uint16)
        codes = np.empty((corners, len(last)), np.float32)
        listed = np.array(starts), pair_block.numpy(), pair_corner.numpy()
        parameters = slices.detach().numpy(), tuple(middle), np.stack(biases), last, of_last
        encode_groups(bits, listed, parameters, groups, hidden, codes)
        ctx.save_for_backward(*layers[1::2])
        ctx.kept = bits, groups, hidden
        return torch.from_numpy(codes)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradients of slices, biases and matrices, float32."""
        *middle, last = (each.detach().numpy() for each in ctx.saved_tensors)
        bits, groups, hidden = ctx.kept
        layers, _, out = hidden.shape
        of_slices, of_last = torch.empty(SLICES, bits.shape[1], out), torch.empty(last.shape)
        of_middle, of_biases = torch.empty(len(middle), out, out), torch.zeros(layers, out)
        found = of_slices.numpy(), of_middle.numpy(), of_biases.numpy(), of_last.numpy()
        differentiate_groups(bits, groups, (tuple(middle), last), hidden, gradient.numpy(), found)
        matrices = [*of_middle.unbind(), of_last]
        of_layers = [part for pair in zip(matrices, [*of_biases[1:], gradient.sum(0)], strict=True) for part in pair]
        return None, of_slices, of_biases[0], *of_layers


class _Rounded(torch.autograd.Function):
    """Numbers rounded to bfloat16; their gradient is handed on, rounded too where that is asked for."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, forward: bool, back: bool) -> Tensor:
        ctx.back = back
        return values.bfloat16().float() if forward else values.clone()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:  # type: ignore[override]
        return gradient.bfloat16().float() if ctx.back else gradient, None, None


def encode_reference(pairs: BlockPairs, slices: Tensor, *layers: Tensor) -> Tensor:
    """Reference of `TiledEncoder` in torch, rounded where it rounds, with a gradient by autograd."""
    blocks, starts, pair_block, pair_corner, corners = pairs
    bias, *others, last, of_last = layers
    sums = torch.zeros(corners, slices.shape[2])
    for s in range(SLICES):
        blocks_here, corners_here = (part[starts[s] : starts[s + 1]] for part in (pair_block, pair_corner))
        products = blocks[blocks_here].float() @ _Rounded.apply(slices[s], True, False)
        sums = sums.index_add(0, corners_here, products)
    hidden = _relu_reference(sums + bias)
    for matrix, added in zip(others[::2], others[1::2], strict=True):
        hidden = _relu_reference(hidden @ _Rounded.apply(matrix, True, False).t() + added)
    return hidden @ last.t() + of_last


def _relu_reference(sums: Tensor) -> Tensor:
    rounded_back: Tensor = _Rounded.apply(sums, False, True)
    result: Tensor = _Rounded.apply(torch.relu(rounded_back), True, False)
    return result
