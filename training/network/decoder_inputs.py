# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the decoder for a tile of views, and the gradient of the codes that they were made of, for kernels.

The same as interpolation, harmonics and concatenation in `torch_model.py`, of which the codes alone have a gradient.
Views are counted through all voxels, each of which has as many; a tile may begin and end within a voxel.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.network.kinds import CODE_SIZE, CORNERS, COVERING, HARMONICS, RAY_INPUTS, SIDE_BY_SIDE, VIEW
from ...patchnet_addon.network.lane_harmonics import store_harmonics
from ...patchnet_addon.network.lanes import LANES, add_product, load, spread, zeros
from ...patchnet_addon.network.weights import MODULATED
from ...patchnet_addon.runtime.aligned_memory import aligned_zeros
from ...patchnet_addon.runtime.kernels import device, lean_device
from ...patchnet_addon.runtime.vectors import select, store

CODE_PLACE = 16  # numbers that a code takes up in gradients, so that it is whole vectors
BESIDE = CORNERS * SIDE_BY_SIDE  # numbers of codes side by side

_DIRECTION = CODE_SIZE
_UP = _DIRECTION + 3
_RATIO = _UP + 3
_TERMS = _RATIO + 1
_VIEW = RAY_INPUTS + BESIDE
_COVERED = _VIEW + VIEW
assert _TERMS + HARMONICS == RAY_INPUTS and CODE_SIZE <= CODE_PLACE <= _TERMS and CODE_PLACE % LANES == 0
_MODULATED = (1 << MODULATED) - 1  # bits of the numbers of a code that harmonics are multiplied into


@device
def write_inputs(eight, rays, near, first, inputs):
    """Write the inputs of the views from `first` on, as `kinds.py` says, into inputs (n, >= 42) or (n, >= 147).

    eight: (V, 8, 10) codes of the corners. rays: entry, direction and up (V R, 3), and ratio (V R,). near: view
    (V R, 9) and covered (V R, 64), without rows for the paper's network. Columns and rows beyond become 0.
    """
    entry, direction, up, ratio = rays
    view, covered = near
    shares, codes = corner_shares(entry, first, len(inputs)), aligned_zeros(CORNERS, CODE_PLACE)
    axes, terms = np.empty((3, LANES), np.float32), aligned_zeros(HARMONICS, LANES)
    count, of_voxel = max(0, min(len(inputs), len(ratio) - first)), len(ratio) // len(eight)
    for start in range(0, count, LANES):
        _write_harmonics(direction, first, (start, min(start + LANES, count)), (axes, terms), inputs)
    row = 0
    while row < count:
        voxel, last = _views_of_voxel(first, row, of_voxel, count)
        _write_codes(eight[voxel], codes, shares, (row, last), inputs)
        row = last
    _write_rays(direction, up, ratio, first, inputs[:count])
    if len(covered) > 0:
        _write_nearby(view, covered, first, inputs[:count])
    inputs[:count, _COVERED + COVERING if len(covered) > 0 else RAY_INPUTS :] = 0
    inputs[count:] = 0


@lean_device
def _views_of_voxel(first, row, of_voxel, count):
    """Voxel that a row of a tile is a view of, and the row after the last such one."""
    voxel = (first + row) // of_voxel
    return voxel, min(count, (voxel + 1) * of_voxel - first)


@device
def add_codes_gradient(gradient, inputs, entry, first, of_codes):
    """Add the gradient of codes, (V, 8, 10), for that of the inputs of the views from `first` on.

    gradient: (n, 16) of the interpolated code, or (n, 48) with that of the numbers side by side behind it. inputs: of
    `write_inputs`, of these views. entry: (V R, 3).
    """
    shares, sums = corner_shares(entry, first, len(inputs)), aligned_zeros(CORNERS, CODE_PLACE)
    count, of_voxel = max(0, min(len(inputs), len(entry) - first)), len(entry) // len(of_codes)
    row = 0
    while row < count:
        voxel, last = _views_of_voxel(first, row, of_voxel, count)
        _sum_codes(gradient, inputs, shares, (row, last), sums)
        _add_voxel(gradient, (row, last), sums, of_codes[voxel])
        row = last


@device
def corner_shares(entry, first, count):
    """Trilinear shares (8, >= count) of the corners, x fastest, at entry points (N, 3) from `first` on.

    Where there are no more points, of the last one.
    """
    width = (count + LANES - 1) // LANES * LANES
    axes, shares = aligned_zeros(3, width), aligned_zeros(CORNERS, width)
    _copy_axes(entry, first, axes)
    one = np.float32(1)
    for corner in range(CORNERS):
        for k in range(width):
            x, y, z = axes[0, k], axes[1, k], axes[2, k]
            along = (x if corner & 1 else one - x) * (y if corner & 2 else one - y)
            shares[corner, k] = along * (z if corner & 4 else one - z)
    return shares


@lean_device
def _copy_axes(vectors, first, axes):
    """Copy vectors (N, 3) from `first` on into axes (3, n), the last one again where there are no more."""
    for k in range(axes.shape[1]):
        at = min(first + k, len(vectors) - 1)
        for axis in range(3):
            axes[axis, k] = vectors[at, axis]


@lean_device
def _write_harmonics(direction, first, rows, scratch, inputs):
    """Write the harmonics of the directions of as many views as a vector has lanes."""
    axes, terms = scratch
    _copy_axes(direction, first + rows[0], axes)
    store_harmonics(terms, 0, LANES, load(axes, 0), load(axes, LANES), load(axes, 2 * LANES))
    for row in range(rows[0], rows[1]):
        for k in range(HARMONICS):
            inputs[row, _TERMS + k] = terms[k, row - rows[0]]


@lean_device
def _write_codes(eight, codes, shares, rows, inputs):
    """Write the codes at the entry points of a voxel's views, harmonics multiplied in, and codes side by side.

    What follows a code is written over, and has to be written afterwards; harmonics have to stand there.
    """
    for corner in range(CORNERS):
        for k in range(CODE_SIZE):
            codes[corner, k] = eight[corner, k]
    width = shares.shape[1]
    for part in range(0, CODE_PLACE, LANES):
        code0, code1 = load(codes, part), load(codes, part + CODE_PLACE)
        code2, code3 = load(codes, part + 2 * CODE_PLACE), load(codes, part + 3 * CODE_PLACE)
        code4, code5 = load(codes, part + 4 * CODE_PLACE), load(codes, part + 5 * CODE_PLACE)
        code6, code7 = load(codes, part + 6 * CODE_PLACE), load(codes, part + 7 * CODE_PLACE)
        for row in range(rows[0], rows[1]):
            code = spread(shares, row) * code0
            code = add_product(code, spread(shares, row + width), code1)
            code = add_product(code, spread(shares, row + 2 * width), code2)
            code = add_product(code, spread(shares, row + 3 * width), code3)
            code = add_product(code, spread(shares, row + 4 * width), code4)
            code = add_product(code, spread(shares, row + 5 * width), code5)
            code = add_product(code, spread(shares, row + 6 * width), code6)
            code = add_product(code, spread(shares, row + 7 * width), code7)
            at = row * inputs.shape[1] + part
            store(inputs, at, _modulated(code, inputs, at + _TERMS, part))
    if inputs.shape[1] > _COVERED:
        for row in range(rows[0], rows[1]):
            for corner in range(CORNERS):
                for k in range(SIDE_BY_SIDE):
                    inputs[row, RAY_INPUTS + SIDE_BY_SIDE * corner + k] = codes[corner, k]


@lean_device
def _modulated(code, inputs, at, part):
    """Vector of a code, from number `part` on, times the harmonics at an index of the inputs (methods 7.13)."""
    return select(_MODULATED >> part, code * load(inputs, at), code)


@lean_device
def _write_rays(direction, up, ratio, first, inputs):
    for row in range(len(inputs)):
        for axis in range(3):
            inputs[row, _DIRECTION + axis] = direction[first + row, axis]
            inputs[row, _UP + axis] = up[first + row, axis]
        inputs[row, _RATIO] = ratio[first + row]


@lean_device
def _write_nearby(view, covered, first, inputs):
    for row in range(len(inputs)):
        for k in range(VIEW):
            inputs[row, _VIEW + k] = view[first + row, k]
        for k in range(COVERING):
            inputs[row, _COVERED + k] = covered[first + row, k]


@lean_device
def _sum_codes(gradient, inputs, shares, rows, sums):
    """Write the gradient of the corners' codes (8, 16) by that of the interpolated codes of a voxel's views."""
    width = shares.shape[1]
    for part in range(0, CODE_PLACE, LANES):
        sum0 = sum1 = sum2 = sum3 = sum4 = sum5 = sum6 = sum7 = zeros()
        for row in range(rows[0], rows[1]):
            code = load(gradient, row * gradient.shape[1] + part)
            code = _modulated(code, inputs, row * inputs.shape[1] + _TERMS + part, part)
            sum0 = add_product(sum0, spread(shares, row), code)
            sum1 = add_product(sum1, spread(shares, row + width), code)
            sum2 = add_product(sum2, spread(shares, row + 2 * width), code)
            sum3 = add_product(sum3, spread(shares, row + 3 * width), code)
            sum4 = add_product(sum4, spread(shares, row + 4 * width), code)
            sum5 = add_product(sum5, spread(shares, row + 5 * width), code)
            sum6 = add_product(sum6, spread(shares, row + 6 * width), code)
            sum7 = add_product(sum7, spread(shares, row + 7 * width), code)
        store(sums, part, sum0)
        store(sums, part + CODE_PLACE, sum1)
        store(sums, part + 2 * CODE_PLACE, sum2)
        store(sums, part + 3 * CODE_PLACE, sum3)
        store(sums, part + 4 * CODE_PLACE, sum4)
        store(sums, part + 5 * CODE_PLACE, sum5)
        store(sums, part + 6 * CODE_PLACE, sum6)
        store(sums, part + 7 * CODE_PLACE, sum7)


@lean_device
def _add_voxel(gradient, rows, sums, of_codes):
    """Add these sums, and the gradients of codes side by side, to those of a voxel's codes (8, 10)."""
    for corner in range(CORNERS):
        for k in range(CODE_SIZE):
            of_codes[corner, k] += sums[corner, k]
    if gradient.shape[1] > CODE_PLACE:
        for row in range(rows[0], rows[1]):
            for corner in range(CORNERS):
                for k in range(SIDE_BY_SIDE):
                    of_codes[corner, k] += gradient[row, CODE_PLACE + SIDE_BY_SIDE * corner + k]
