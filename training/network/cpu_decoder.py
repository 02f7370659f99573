# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of a batch on the CPU, forward and backward, by one kernel each.

The same as `PatchNet.decode` and `PatchNet.decode_mixture` by torch's own steps, which are so many that threads which
learn side by side would wait for the interpreter's lock again and again.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.kinds import CODE_SIZE, CORNERS
from ...patchnet_addon.network.lanes import LANES
from ...patchnet_addon.runtime.aligned_memory import aligned
from ..data.tensor_batch import TensorBatch
from .decoder_kernels import decode_views, differentiate_views
from .decoder_products import ROWS, filled

_filled = filled.py_func  # type: ignore[attr-defined]


class CpuDecoder(torch.autograd.Function):
    """Coverage and luminance (V R, 2) of codes (V, 8, 10); the gradient goes to the codes and to the layers."""

    @staticmethod
    def forward(ctx: Any, eight: Tensor, batch: TensorBatch, *layers: Tensor) -> Tensor:
        """Results of `layers`, matrices (out, in) and biases (out,) in turn, float32; ReLUs stand between them."""
        matrices, biases = (tuple(map(_array, each)) for each in (layers[::2], layers[1::2]))
        entry, direction, up = map(_rows, (batch.entry, batch.direction, batch.up))
        rays = entry, direction, up, _array(batch.ratio).ravel()
        view = covered = luminances = np.empty((0, 0), np.float32)
        if batch.nearby is not None:
            view, covered, luminances = map(_rows, (batch.nearby.view, batch.nearby.covered, batch.nearby.luminances))
        found, kept = torch.empty(len(entry), 2), _empty_kept(len(entry), matrices)
        decode_views(_array(eight), rays, (view, covered), luminances, (matrices, biases), kept, found.numpy())
        ctx.save_for_backward(*layers[::2])
        ctx.kept, ctx.entry, ctx.voxels = kept, entry, len(eight)
        return found

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradients of codes and layers."""
        matrices = tuple(map(_array, ctx.saved_tensors))
        of_matrices = [torch.empty(matrix.shape) for matrix in matrices]
        of_biases = [torch.empty(len(matrix)) for matrix in matrices]
        of_codes = torch.empty(ctx.voxels, CORNERS, CODE_SIZE)
        of_layers = tuple(map(_array, of_matrices)), tuple(map(_array, of_biases))
        differentiate_views(_array(gradient), ctx.kept, ctx.entry, matrices, of_codes.numpy(), of_layers)
        return of_codes, None, *itertools.chain.from_iterable(zip(of_matrices, of_biases, strict=True))


def _empty_kept(views: int, matrices: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arrays of what `differentiate_views` needs of a forward pass."""
    rows = _filled(views, ROWS)
    inputs, width, outputs = (_filled(count, LANES) for count in (matrices[0].shape[1], *map(len, matrices[-2:])))
    shapes = (rows, inputs), (len(matrices) - 1, rows, width), (rows, outputs)
    kept = [aligned(shape, np.float32) for shape in shapes]
    return kept[0], kept[1], kept[2]


def _array(tensor: Tensor) -> np.ndarray:
    """Memory of a tensor, in C order."""
    return tensor.contiguous().numpy(force=True)


def _rows(tensor: Tensor) -> np.ndarray:
    """Array (V R, width) of what R views of V voxels have, (V, R, width)."""
    return _array(tensor).reshape(-1, tensor.shape[-1])
