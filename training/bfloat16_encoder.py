# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder's layers with a ReLU in bfloat16 on the CPU, forward and backward, without torch's steps between products.

The same as `CornerLayer` and the linear layers after it in bfloat16, but that biases are added, and their gradients
summed, in float32.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from .bfloat16 import SLICES, add_bias, add_pairs, mask_gradient


class Bfloat16Encoder(torch.autograd.Function):
    """Hidden values (corners, out) float32 of the occupied blocks of a batch; the gradient goes to the parameters."""

    @staticmethod
    def forward(
        ctx: Any,
        blocks: Tensor,
        starts: list[int],
        pair_block: Tensor,
        pair_corner: Tensor,
        corners: int,
        slices: Tensor,
        bias: Tensor,
        *layers: Tensor,
    ) -> Tensor:
        """Results of slices (8, B, out), a bias (out,) and `layers`: matrices (out, out) and biases (out,) in turn.

        blocks: (M, B) float32. The others as in `CornerLayer`.
        """
        narrow = blocks.bfloat16()
        rows = torch.empty(len(pair_block), blocks.shape[1], dtype=torch.bfloat16)
        matrices = [matrix.bfloat16() for matrix in layers[::2]]
        first = slices.bfloat16()
        products = torch.empty(len(rows), first.shape[2], dtype=torch.bfloat16)
        for s in range(SLICES):
            here = slice(starts[s], starts[s + 1])  # its rows are in the processor's cache when they are multiplied
            of_slice = torch.index_select(narrow, 0, pair_block[here], out=rows[here])
            torch.mm(of_slice, first[s], out=products[here])
        hidden = [add_pairs(products, starts, pair_corner, bias, corners)]
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
        after = gradient.bfloat16()
        for layer in reversed(range(count)):
            of_bias = mask_gradient(after, hidden[layer + 1])
            of_layers[:0] = [(after.t() @ hidden[layer]).float(), of_bias]
            after = after @ matrices[layer]
        of_bias = mask_gradient(after, hidden[0])
        of_slices = torch.empty(SLICES, rows.shape[1], after.shape[1])
        of_slice = torch.empty_like(after)  # stays in the processor's cache from the copy to the product
        for s in range(SLICES):
            here = slice(ctx.starts[s], ctx.starts[s + 1])
            copied = torch.index_select(after, 0, pair_corner[here], out=of_slice[: here.stop - here.start])
            of_slices[s] = (copied.t() @ rows[here]).t()
        return None, None, None, None, None, of_slices, of_bias, *of_layers
