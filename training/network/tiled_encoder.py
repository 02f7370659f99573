# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder of a batch in matrix units: its reference in torch, and how its kernels work.

They are those of `tiled_forward.py` and `tiled_backward.py`, which `tiled_step.py` calls.

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

import torch
from torch import Tensor

from .corner_layer import SLICES, BlockPairs


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
    """Codes (corners, 10) float32 of the occupied blocks of a batch, rounded where the kernels round.

    slices: (8, B, width). layers: a bias (width,), then matrices and biases in turn. Autograd knows the gradient.
    """
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
