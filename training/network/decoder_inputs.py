# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the decoder for all views of a batch, and the gradient of the codes, in one kernel each on the CPU.

The same as interpolation, harmonics and concatenation in `torch_model.py`, of which the codes alone have a gradient.
The kernels are serial, since several threads learn from a part of a step each.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.network.kinds import CODE_SIZE, CORNERS, COVERING, HARMONICS, RAY_INPUTS, SIDE_BY_SIDE, VIEW
from ...patchnet_addon.network.lane_harmonics import store_harmonics
from ...patchnet_addon.network.lanes import LANES, load
from ...patchnet_addon.network.weights import MODULATED
from ...patchnet_addon.runtime.kernels import device, kernel
from ..data.tensor_batch import TensorBatch

_DIRECTION = CODE_SIZE
_UP = _DIRECTION + 3
_RATIO = _UP + 3
_TERMS = _RATIO + 1
_VIEW = RAY_INPUTS + CORNERS * SIDE_BY_SIDE
_COVERED = _VIEW + VIEW
assert _TERMS + HARMONICS == RAY_INPUTS


def decoder_inputs(eight: np.ndarray, batch: TensorBatch) -> np.ndarray:
    """Inputs (V R, 42) of the paper's decoder or (V R, 147) of the mixture's, for codes (V, 8, 10) of the corners."""
    views, near = batch.ratio.numel(), batch.nearby
    inputs = np.empty((views, RAY_INPUTS if near is None else _COVERED + COVERING), np.float32)
    rays = tuple(part.numpy() for part in (batch.entry, batch.direction, batch.up, batch.ratio))
    _write(eight, rays, inputs)
    if near is not None:
        _write_nearby(near.view.view(views, -1).numpy(), near.covered.view(views, -1).numpy(), inputs)
    return inputs


def codes_gradient(gradient: np.ndarray, inputs: np.ndarray, entry: np.ndarray) -> np.ndarray:
    """Gradient (V, 8, 10) of the corners' codes for that of `inputs`, which they had made; entry: (V, R, 3)."""
    result = np.zeros((len(entry), CORNERS, CODE_SIZE), np.float32)
    _add_gradient(gradient, inputs, entry, result)
    return result


@device
def _share(entry, voxel, view, corner):
    """Trilinear share of a corner, x fastest, at a view's entry point."""
    x, y, z = entry[voxel, view, 0], entry[voxel, view, 1], entry[voxel, view, 2]
    one = np.float32(1)
    along = x if corner & 1 else one - x
    along *= y if corner & 2 else one - y
    return along * (z if corner & 4 else one - z)


@kernel
def _write(eight, rays, inputs):
    entry, direction, up, ratio = rays
    views, count = ratio.shape[1], ratio.size
    axes, terms = np.zeros((3, LANES), np.float32), np.empty((HARMONICS, LANES), np.float32)
    for first in range(0, count, LANES):
        last = min(first + LANES, count)
        for row in range(first, last):
            for axis in range(3):
                axes[axis, row - first] = direction[row // views, row % views, axis]
        store_harmonics(terms, 0, LANES, load(axes, 0), load(axes, LANES), load(axes, 2 * LANES))
        for row in range(first, last):
            voxel, view, values = row // views, row % views, inputs[row]
            for k in range(CODE_SIZE):
                values[k] = 0
            for corner in range(CORNERS):
                share = _share(entry, voxel, view, corner)
                for k in range(CODE_SIZE):
                    values[k] += share * eight[voxel, corner, k]
            for k in range(HARMONICS):
                values[_TERMS + k] = terms[k, row - first]
            for k in range(MODULATED):
                values[k] *= values[_TERMS + k]
            for axis in range(3):
                values[_DIRECTION + axis] = direction[voxel, view, axis]
                values[_UP + axis] = up[voxel, view, axis]
            values[_RATIO] = ratio[voxel, view]
            if len(values) > RAY_INPUTS:
                for corner in range(CORNERS):
                    for k in range(SIDE_BY_SIDE):
                        values[RAY_INPUTS + SIDE_BY_SIDE * corner + k] = eight[voxel, corner, k]


@kernel
def _write_nearby(view, covered, inputs):
    for row in range(len(inputs)):
        for k in range(VIEW):
            inputs[row, _VIEW + k] = view[row, k]
        for k in range(COVERING):
            inputs[row, _COVERED + k] = covered[row, k]


@kernel
def _add_gradient(gradient, inputs, entry, result):
    views = entry.shape[1]
    whole = np.empty(CODE_SIZE, np.float32)
    for voxel in range(len(result)):
        for view in range(views):
            row = voxel * views + view
            for k in range(CODE_SIZE):
                whole[k] = gradient[row, k] * (inputs[row, _TERMS + k] if k < MODULATED else np.float32(1))
            for corner in range(CORNERS):
                share = _share(entry, voxel, view, corner)
                for k in range(CODE_SIZE):
                    result[voxel, corner, k] += share * whole[k]
            if gradient.shape[1] > RAY_INPUTS:
                for corner in range(CORNERS):
                    for k in range(SIDE_BY_SIDE):
                        result[voxel, corner, k] += gradient[row, RAY_INPUTS + SIDE_BY_SIDE * corner + k]
