# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products of a training step: which ones there are, and the time in which torch does these alone.

A training step that multiplies by torch cannot take less. They are those of the encoder `mlp` and of the decoder,
forward and backward, each whole, whoever does them in a step and in whatever pieces, and are done on numbers of their
own, one after the other, results written to memory that is there. Done once, each reads its numbers from memory, where
in a step it finds in the processor's cache what was just written: so each can be done several times in a row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from ...patchnet_addon.network.kinds import CODE_SIZE, CORNERS, SIDE_BY_SIDE, NetworkKind
from ..data.tensor_batch import TensorBatch
from ..network.corner_layer import SLICES
from ..network.cpu_encoder import ROW_STEP


class Operand(NamedTuple):
    """Matrix, or several of a batch, that a product reads; turned: its numbers lie in columns."""

    shape: tuple[int, ...]
    dtype: torch.dtype
    turned: bool = False

    def filled(self) -> Tensor:
        """Tensor of random numbers."""
        *several, rows, columns = self.shape
        if self.turned:
            return torch.randn(*several, columns, rows).to(self.dtype).transpose(-1, -2)
        return torch.randn(self.shape).to(self.dtype)


Product = tuple[Operand, Operand]


def step_products(batch: TensorBatch, kind: NetworkKind, encoder_width: int, dtype: torch.dtype) -> list[Product]:
    """Products of a step on a batch, with those of the encoder but its last one in `dtype`.

    What has no use is not among them: empty blocks, and gradients of what is no parameter and made of none.
    """
    corners, views, values = 8 * len(batch.ratio), batch.ratio.numel(), batch.blocks.shape[1]
    most = max(last - first for first, last in pairwise(batch.slice_start))
    pairs, out = -(-most // ROW_STEP) * ROW_STEP, encoder_width
    found = [(Operand((SLICES, pairs, values), dtype), Operand((SLICES, values, out), dtype))]
    rows, gradients = (SLICES, pairs, values), (SLICES, pairs, out)
    if values > out and dtype != torch.float32:  # whichever torch does faster
        found.append((Operand(_turned(gradients), dtype, turned=True), Operand(rows, dtype)))
    else:
        found.append((Operand(_turned(rows), dtype, turned=True), Operand(gradients, dtype)))
    for _ in range(2):  # between the first and the last layer
        found += _of_layer(corners, out, out, dtype)
    found += _of_layer(corners, out, CODE_SIZE, torch.float32)
    first, *others = pairwise(kind.decoder)
    of_codes = CODE_SIZE + (CORNERS * SIDE_BY_SIDE if kind.mixes else 0)  # inputs that are made of codes
    found += _of_layer(views, *first, torch.float32)[:2]
    found.append((Operand((views, first[1]), torch.float32), Operand((first[1], of_codes), torch.float32)))
    for inputs, outputs in others:
        found += _of_layer(views, inputs, outputs, torch.float32)
    return found


def _of_layer(rows: int, inputs: int, outputs: int, dtype: torch.dtype) -> list[Product]:
    """Values, gradient of the matrix and gradient of what it is given, of a layer with a matrix (outputs, inputs)."""
    values, gradients = Operand((rows, inputs), dtype), Operand((rows, outputs), dtype)
    turned = Operand((outputs, rows), dtype, turned=True)
    return [
        (values, Operand((inputs, outputs), dtype, turned=True)),
        (turned, values),
        (gradients, Operand((outputs, inputs), dtype)),
    ]


def _turned(shape: tuple[int, ...]) -> tuple[int, ...]:
    *several, rows, columns = shape
    return (*several, columns, rows)


def replay(products: Sequence[Product], times: int = 1) -> Callable[[], None]:
    """Function that does products on numbers of its own, each so many times in a row."""
    operands = [(first.filled(), second.filled()) for first, second in products]
    ready = [(first, second, first @ second) for first, second in operands]

    def run() -> None:
        for first, second, result in ready:
            for _ in range(times):
                torch.matmul(first, second, out=result)

    return run


def operations(products: Sequence[Product]) -> int:
    """Multiplications and additions of products."""
    return sum(2 * torch.Size(first.shape).numel() * second.shape[-1] for first, second in products)
