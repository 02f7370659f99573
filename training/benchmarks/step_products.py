# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products of a training step: which ones torch is asked for, and the time of these alone.

A training step cannot take less than its products. They are recorded while a step runs, with sizes, strides and number
types, and done again on other numbers, one after the other, results written to memory that is there. Done once, each
reads numbers of its own from memory, where in a step it finds in the processor's cache what was just written: so
each can be done several times in a row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

_ADDED = {torch.ops.aten.addmm, torch.ops.aten.baddbmm}  # the first operand is added to the product
_PRODUCTS = {torch.ops.aten.mm, torch.ops.aten.bmm} | _ADDED


class Operand(NamedTuple):
    """Matrix, or several of a batch, that a product reads."""

    shape: tuple[int, ...]
    stride: tuple[int, ...]
    dtype: torch.dtype

    @classmethod
    def of(cls, tensor: Tensor) -> Operand:
        """Sizes of a tensor."""
        return cls(tuple(tensor.shape), tuple(tensor.stride()), tensor.dtype)

    def filled(self) -> Tensor:
        """Tensor of random numbers with these sizes; one that repeats itself is written out."""
        if 0 in self.stride:
            return torch.randn(self.shape).to(self.dtype)
        return torch.empty_strided(self.shape, self.stride, dtype=self.dtype).copy_(torch.randn(self.shape))


Product = tuple[Operand, Operand]


class _Recorder(TorchDispatchMode):
    """Recorder of all products that torch does in this thread."""

    def __init__(self) -> None:
        super().__init__()
        self.products: list[Product] = []

    def __torch_dispatch__(
        self, function: Any, types: Any, arguments: Sequence[Any] = (), keywords: Mapping[str, Any] | None = None
    ) -> Any:
        kind = function.overloadpacket
        if kind in _PRODUCTS:
            first, second = arguments[1:3] if kind in _ADDED else arguments[:2]
            self.products.append((Operand.of(first), Operand.of(second)))
        return function(*arguments, **(keywords or {}))


@contextmanager
def recorded_products() -> Iterator[list[Product]]:
    """List of the products that torch does within the block, in this thread; full when the block ends."""
    recorder = _Recorder()
    with recorder:
        yield recorder.products


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
