# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands between the products of layers on the CPU: kernels that add them, with biases and ReLUs, in one pass.

For float32 and bfloat16. bfloat16 has 8 bits of mantissa: a sum that is kept in it stands still once terms are below
its 256th part. All that is added here is added in float32, and rounded once. The kernels read and write the bits of
bfloat16 as uint16, and are serial, since several threads learn from a part of a step each.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.runtime.kernels import kernel
from ..data.bfloat16 import narrow_bits, wide_value
from .corner_layer import SLICES


def gather_rows(values: Tensor, index: Tensor, starts: list[int], count: int) -> Tensor:
    """Rows (8, count, width) of values (N, width), float32 or bfloat16: of slice s those at index starts[s] on.

    What a slice has less than `count`, the next one's start, is zeros.
    """
    rows = torch.empty(SLICES, count, values.shape[1], dtype=values.dtype)
    _gather_rows(_numbers(values), index.numpy(), np.array(starts), _numbers(rows))
    return rows


def gather_rows_reference(values: Tensor, index: Tensor, starts: list[int], count: int) -> Tensor:
    """Reference of `gather_rows` in torch."""
    rows = torch.zeros(SLICES, count, values.shape[1], dtype=values.dtype)
    for s in range(SLICES):
        rows[s, : starts[s + 1] - starts[s]] = values[index[starts[s] : starts[s + 1]]]
    return rows


def add_pairs(products: Tensor, starts: list[int], pair_corner: Tensor, bias: Tensor, corners: int) -> Tensor:
    """ReLU of bias (out,) float32 and the products (8, count, out) of each corner, (corners, out) of their type.

    Pairs starts[s] to starts[s + 1] are those of slice s, in which no corner is twice; their products are the first of
    the slice.
    """
    result = torch.empty(corners, products.shape[2], dtype=products.dtype)
    rows = np.full((corners, SLICES), -1, np.int64)
    _list_rows(np.array(starts), pair_corner.numpy(), rows)
    add = _add_narrow_rows if products.dtype == torch.bfloat16 else _add_rows
    add(_numbers(products), rows, bias.detach().numpy(), _numbers(result))
    return result


def add_pairs_reference(products: Tensor, starts: list[int], pair_corner: Tensor, bias: Tensor, corners: int) -> Tensor:
    """Reference of `add_pairs` in torch, for any type and device."""
    sums = torch.zeros(corners, products.shape[2], device=products.device)
    for s in range(SLICES):
        pairs = pair_corner[starts[s] : starts[s + 1]]
        sums.index_add_(0, pairs, products[s, : len(pairs)].float())
    return torch.relu(sums + bias).to(products.dtype)


def add_bias(products: Tensor, bias: Tensor) -> Tensor:
    """ReLU of products (N, out), float32 or bfloat16, and bias (out,) float32, in the memory of the products."""
    add = _add_narrow_bias if products.dtype == torch.bfloat16 else _add_bias
    add(_numbers(products), bias.detach().numpy())
    return products


def mask_gradient(gradient: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
    """Gradient (N, out) in the type of `hidden`, 0 where these results of a ReLU are, and its column sums (out,).

    The sums, float32, are the gradient of the bias. gradient: of the type of `hidden`, and then changed, or float32.
    """
    sums = torch.zeros(gradient.shape[1])
    if hidden.dtype == torch.float32:
        _mask(gradient.numpy(), hidden.numpy(), sums.numpy())
        return gradient, sums
    if gradient.dtype == torch.bfloat16:
        _mask_narrow(_numbers(gradient), _numbers(hidden), sums.numpy())
        return gradient, sums
    narrow = torch.empty_like(hidden)
    _mask_to_narrow(gradient.numpy(), _numbers(hidden), _numbers(narrow), sums.numpy())
    return narrow, sums


def _numbers(tensor: Tensor) -> np.ndarray:
    """Memory of a tensor on the CPU as an array: float32, or the bits of bfloat16 as uint16."""
    plain = tensor.detach()
    return plain.view(torch.int16).numpy().view(np.uint16) if tensor.dtype == torch.bfloat16 else plain.numpy()


@kernel
def _gather_rows(values, index, starts, rows):
    for s in range(SLICES):
        count = starts[s + 1] - starts[s]
        for row in range(count):
            source = index[starts[s] + row]
            for k in range(values.shape[1]):  # an assignment of rows takes three times as long
                rows[s, row, k] = values[source, k]
        rows[s, count:] = 0


@kernel
def _list_rows(starts, pair_corner, rows):
    for s in range(SLICES):
        for pair in range(starts[s], starts[s + 1]):
            rows[pair_corner[pair], s] = pair - starts[s]


@kernel
def _add_rows(products, rows, bias, result):
    for corner in range(len(rows)):
        for k in range(len(bias)):
            result[corner, k] = bias[k]
        for s in range(SLICES):
            if rows[corner, s] >= 0:
                row = products[s, rows[corner, s]]
                for k in range(len(bias)):
                    result[corner, k] += row[k]
        for k in range(len(bias)):
            result[corner, k] = max(result[corner, k], np.float32(0))


@kernel
def _add_narrow_rows(products, rows, bias, result):
    total = np.empty(len(bias), np.float32)
    for corner in range(len(rows)):
        for k in range(len(bias)):
            total[k] = bias[k]
        for s in range(SLICES):
            if rows[corner, s] >= 0:
                row = products[s, rows[corner, s]]
                for k in range(len(bias)):
                    total[k] += wide_value(row[k])
        for k in range(len(bias)):
            result[corner, k] = narrow_bits(max(total[k], np.float32(0)))


@kernel
def _add_bias(products, bias):
    for row in range(len(products)):
        for k in range(len(bias)):
            products[row, k] = max(products[row, k] + bias[k], np.float32(0))


@kernel
def _add_narrow_bias(products, bias):
    for row in range(len(products)):
        for k in range(len(bias)):
            products[row, k] = narrow_bits(max(wide_value(products[row, k]) + bias[k], np.float32(0)))


@kernel
def _mask(gradient, hidden, sums):
    for row in range(len(gradient)):
        for k in range(len(sums)):
            there = gradient[row, k] if hidden[row, k] > 0 else np.float32(0)
            gradient[row, k] = there
            sums[k] += there


@kernel
def _mask_narrow(gradient, hidden, sums):
    for row in range(len(gradient)):
        for k in range(len(sums)):
            there = gradient[row, k] if hidden[row, k] > 0 else np.uint16(0)
            gradient[row, k] = there
            sums[k] += wide_value(there)


@kernel
def _mask_to_narrow(gradient, hidden, narrow, sums):
    for row in range(len(gradient)):
        for k in range(len(sums)):
            there = narrow_bits(gradient[row, k]) if hidden[row, k] > 0 else np.uint16(0)
            narrow[row, k] = there
            sums[k] += wide_value(there)
