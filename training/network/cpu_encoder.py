# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder's layers with a ReLU on the CPU, forward and backward, without torch's steps between products.

The same as `corner_sums` and the linear layers after it, but that biases are added, and their gradients summed, in
float32 where products are in bfloat16.
"""

from __future__ import annotations

import itertools
from typing import Any

import torch
from torch import Tensor

from .corner_layer import BlockPairs
from .cpu_layers import add_bias, add_pairs, gather_rows, mask_gradient

# Slices are filled up to a multiple of this many rows: torch compiles a product for each new size, which takes longer
# than to multiply, and how many pairs a slice has differs at every step. With few sizes all are compiled soon.
ROW_STEP = 64


class CpuEncoder(torch.autograd.Function):
    """Hidden values (corners, out) float32 of the occupied blocks of a batch; the gradient goes to the parameters."""

    @staticmethod
    def forward(
        ctx: Any,
        dtype: torch.dtype,
        pairs: BlockPairs,
        slices: Tensor,
        bias: Tensor,
        *layers: Tensor,
    ) -> Tensor:
        """Results of slices (8, B, out), a bias (out,) and `layers`: matrices (out, out) and biases (out,) in turn.

        dtype: of the products, float32 or bfloat16; the parameters are float32, the blocks of either type.
        """
        blocks, starts, pair_block, pair_corner, corners = pairs
        matrices = [matrix.to(dtype) for matrix in layers[::2]]
        most = max(last - first for first, last in itertools.pairwise(starts))
        rows = gather_rows(blocks.to(dtype), pair_block, starts, -(-most // ROW_STEP) * ROW_STEP)
        hidden = [add_pairs(torch.bmm(rows, slices.to(dtype)), starts, pair_corner, bias, corners)]
        for matrix, added in zip(matrices, layers[1::2], strict=True):
            hidden.append(add_bias(hidden[-1] @ matrix.t(), added))
        ctx.save_for_backward(rows, pair_corner, *hidden, *matrices)
        ctx.starts = starts
        return hidden[-1].float()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradients of slices, bias and layers, float32."""
        rows, pair_corner, *others = ctx.saved_tensors
        count = len(others) // 2
        hidden, matrices = others[: count + 1], others[count + 1 :]
        of_layers: list[Tensor] = []
        own = gradient.clone() if gradient.dtype == hidden[-1].dtype else gradient  # what autograd gives is not changed
        after, of_bias = mask_gradient(own, hidden[-1])
        for layer in reversed(range(count)):
            of_layers[:0] = [(after.t() @ hidden[layer]).float(), of_bias]
            after, of_bias = mask_gradient(after @ matrices[layer], hidden[layer])
        copied = gather_rows(after, pair_corner, ctx.starts, rows.shape[1])
        of_slices = _slices_gradient(rows, copied)
        return None, None, of_slices, of_bias, *of_layers


def _slices_gradient(rows: Tensor, gradients: Tensor) -> Tensor:
    """Gradient (8, B, out) float32 of slices, of their rows (8, N, B) and the rows' gradients (8, N, out)."""
    if rows.dtype == torch.float32 or rows.shape[2] <= gradients.shape[2]:
        return torch.bmm(rows.transpose(1, 2), gradients).float()
    result = torch.empty(len(rows), rows.shape[2], gradients.shape[2])
    return result.copy_(torch.bmm(gradients.transpose(1, 2), rows).transpose(1, 2))  # faster, where blocks are wider
