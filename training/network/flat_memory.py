# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat memory of a network's parameters: all of them one behind the other, so that a kernel is given one array.

To find the memory of sixteen tensors at each step takes Python as long as a kernel takes for a part of the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.runtime.kernels import device
from .corner_layer import SLICES

MIDDLE = 2  # layers between an encoder's first and its last
DECODER_LAYERS = 4


class Sizes(NamedTuple):
    """Sizes of a network with the encoder `mlp`, as kernels are given them.

    values: numbers B of a block. width: of a layer of the encoder. codes: of a code. decoder: (5,) int64, inputs of the
    decoder and outputs of its layers.
    """

    values: int
    width: int
    codes: int
    decoder: np.ndarray


def flat_memory(tensors: Sequence[Tensor]) -> Tensor:
    """Tensor (n,) of the numbers of float32 tensors on one device, which lie there from now on, in their order."""
    first, place = tensors[0], tensors[0].data_ptr()
    memory = first.untyped_storage()
    for tensor in tensors:
        beside = tensor.data_ptr() == place and tensor.untyped_storage().data_ptr() == memory.data_ptr()
        if not beside or not tensor.is_contiguous():
            break
        place += tensor.element_size() * tensor.numel()
    else:
        return first.detach().as_strided((sum(tensor.numel() for tensor in tensors),), (1,))
    flat = torch.cat([tensor.detach().reshape(-1) for tensor in tensors])
    for tensor, part in zip(tensors, flat.split([tensor.numel() for tensor in tensors]), strict=True):
        tensor.data = part.view(tensor.shape)
    return flat


def flat_gradient(gradients: Sequence[Tensor]) -> Tensor:
    """Gradients of parameters as one tensor (n,), in the order of `flat_memory`."""
    return torch.cat([gradient.reshape(-1) for gradient in gradients])


@device
def slices_part(flat, sizes):  # type: ignore[no-untyped-def]
    """Slices (8, B, width) of the encoder's first layer, which are the first of the parameters."""
    return flat[: SLICES * sizes.values * sizes.width].reshape((SLICES, sizes.values, sizes.width))


@device
def middle_start(layer, sizes):  # type: ignore[no-untyped-def]
    """Where the matrix (width, width) of a layer after the first, 0 or 1, begins; or what comes after them, by 2."""
    return SLICES * sizes.values * sizes.width + sizes.width + layer * sizes.width * (sizes.width + 1)


@device
def middle_parts(flat, sizes):  # type: ignore[no-untyped-def]
    """Matrices (width, width) between the encoder's first layer and its last."""
    first, second = middle_start(0, sizes), middle_start(1, sizes)
    return _matrix(flat, first, sizes.width, sizes.width), _matrix(flat, second, sizes.width, sizes.width)


@device
def bias_part(flat, layer, sizes):  # type: ignore[no-untyped-def]
    """Bias (width,) of a layer of the encoder but its last."""
    end = middle_start(layer, sizes)
    return flat[end - sizes.width : end]


@device
def last_parts(flat, sizes):  # type: ignore[no-untyped-def]
    """Last matrix (codes, width) of the encoder and its bias (codes,)."""
    start = middle_start(MIDDLE, sizes)
    end = start + sizes.codes * sizes.width
    return _matrix(flat, start, sizes.codes, sizes.width), flat[end : end + sizes.codes]


@device
def decoder_parts(flat, sizes):  # type: ignore[no-untyped-def]
    """Matrices (out, in) and biases (out,) of the decoder's layers."""
    start = middle_start(MIDDLE, sizes) + sizes.codes * (sizes.width + 1)
    return _layers(flat[start:], sizes.decoder)


@device
def _layers(flat, widths):  # type: ignore[no-untyped-def]
    starts = np.zeros(DECODER_LAYERS + 1, np.int64)
    for k in range(DECODER_LAYERS):
        starts[k + 1] = starts[k] + widths[k + 1] * (widths[k] + 1)
    matrices = (
        _matrix(flat, starts[0], widths[1], widths[0]),
        _matrix(flat, starts[1], widths[2], widths[1]),
        _matrix(flat, starts[2], widths[3], widths[2]),
        _matrix(flat, starts[3], widths[4], widths[3]),
    )
    biases = (
        flat[starts[1] - widths[1] : starts[1]],
        flat[starts[2] - widths[2] : starts[2]],
        flat[starts[3] - widths[3] : starts[3]],
        flat[starts[4] - widths[4] : starts[4]],
    )
    return matrices, biases


@device
def _matrix(flat, start, rows, columns):  # type: ignore[no-untyped-def]
    return flat[start : start + rows * columns].reshape((rows, columns))
