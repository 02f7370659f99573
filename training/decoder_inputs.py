# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the decoder for all views of a batch, and their gradient, in one kernel each on the CPU.

The same as interpolation, harmonics and concatenation in `torch_model.py`, of which the codes alone have a gradient.
The kernels are serial, since several threads learn from a part of a step each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..patchnet_addon.network.harmonics import real_harmonics
from ..patchnet_addon.network.kinds import CODE_SIZE, CORNERS, COVERING, HARMONICS, RAY_INPUTS, SIDE_BY_SIDE, VIEW
from ..patchnet_addon.network.weights import MODULATED
from ..patchnet_addon.runtime.kernels import device, kernel
from .tensor_batch import TensorBatch

_DIRECTION = CODE_SIZE
_UP = _DIRECTION + 3
_RATIO = _UP + 3
_TERMS = _RATIO + 1
_VIEW = RAY_INPUTS + CORNERS * SIDE_BY_SIDE
_COVERED = _VIEW + VIEW
assert _TERMS + HARMONICS == RAY_INPUTS


class DecoderInputs(torch.autograd.Function):
    """Inputs (V R, 42) of the paper's decoder or (V R, 147) of the mixture's; the gradient goes to the codes."""

    @staticmethod
    def forward(ctx: Any, eight: Tensor, batch: TensorBatch) -> Tensor:
        """Inputs for codes (V, 8, 10) of the voxels' corners, float32 on the CPU."""
        views = batch.ratio.numel()
        near = batch.nearby
        inputs = np.empty((views, RAY_INPUTS if near is None else _COVERED + COVERING), np.float32)
        terms = real_harmonics(batch.direction.reshape(views, 3).numpy())
        rays = tuple(part.numpy() for part in (batch.entry, batch.direction, batch.up, batch.ratio))
        _write(eight.detach().numpy(), rays, terms, inputs)
        if near is not None:
            inputs[:, _VIEW:_COVERED] = near.view.view(views, -1).numpy()
            inputs[:, _COVERED:] = near.covered.view(views, -1).numpy()
        ctx.eight, ctx.entry, ctx.terms = eight.shape, batch.entry, terms
        return torch.from_numpy(inputs)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradient (V, 8, 10) of the codes."""
        result = np.zeros(ctx.eight, np.float32)
        _add_gradient(gradient.numpy(), ctx.entry.numpy(), ctx.terms, result)
        return torch.from_numpy(result), None


@device
def _share(entry, voxel, view, corner):
    """Trilinear share of a corner, x fastest, at a view's entry point."""
    x, y, z = entry[voxel, view, 0], entry[voxel, view, 1], entry[voxel, view, 2]
    one = np.float32(1)
    along = x if corner & 1 else one - x
    along *= y if corner & 2 else one - y
    return along * (z if corner & 4 else one - z)


@kernel
def _write(eight, rays, terms, inputs):
    entry, direction, up, ratio = rays
    views = ratio.shape[1]
    for voxel in range(len(ratio)):
        for view in range(views):
            row = voxel * views + view
            values = inputs[row]
            values[:CODE_SIZE] = 0
            for corner in range(CORNERS):
                share = _share(entry, voxel, view, corner)
                for k in range(CODE_SIZE):
                    values[k] += share * eight[voxel, corner, k]
            for k in range(MODULATED):
                values[k] *= terms[row, k]
            for axis in range(3):
                values[_DIRECTION + axis] = direction[voxel, view, axis]
                values[_UP + axis] = up[voxel, view, axis]
            values[_RATIO] = ratio[voxel, view]
            for k in range(HARMONICS):
                values[_TERMS + k] = terms[row, k]
            if len(values) > RAY_INPUTS:
                for corner in range(CORNERS):
                    for k in range(SIDE_BY_SIDE):
                        values[RAY_INPUTS + SIDE_BY_SIDE * corner + k] = eight[voxel, corner, k]


@kernel
def _add_gradient(gradient, entry, terms, result):
    views = entry.shape[1]
    whole = np.empty(CODE_SIZE, np.float32)
    for voxel in range(len(result)):
        for view in range(views):
            row = voxel * views + view
            for k in range(CODE_SIZE):
                whole[k] = gradient[row, k] * (terms[row, k] if k < MODULATED else np.float32(1))
            for corner in range(CORNERS):
                share = _share(entry, voxel, view, corner)
                for k in range(CODE_SIZE):
                    result[voxel, corner, k] += share * whole[k]
            if gradient.shape[1] > RAY_INPUTS:
                for corner in range(CORNERS):
                    for k in range(SIDE_BY_SIDE):
                        result[voxel, corner, k] += gradient[row, RAY_INPUTS + SIDE_BY_SIDE * corner + k]
