# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernel of the encoder backward in matrix units, see `tiled_encoder.py`."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.aligned_memory import aligned_bits, aligned_floats
from ...patchnet_addon.runtime.kernels import device, kernel, lean_device
from ..data.bfloat16 import narrow_bits, wide_value
from .corner_layer import SLICES
from .matrix_units import SIDE, clear_sums, leave_units, store_sums, use_units
from .tiled_forward import ENDS
from .tiled_packing import pack_rows
from .tiled_products import (
    BLOCK,
    TILE,
    add_columns,
    add_groups,
    add_lines,
    pair_group,
    pair_lines,
    turn_lines,
    write_blocks,
    write_masked,
    write_turned_blocks,
)

_TOGETHER = 8  # groups whose pairs lie in the cache while the gradient of a matrix is summed over their corners


@kernel
def differentiate_groups(bits, groups, matrices, hidden, gradient, found):  # type: ignore[no-untyped-def]
    """Write the gradients of all parameters but the last bias, of that of codes (corners, codes).

    matrices: `Packed`, and the last one (codes, out). found: those of slices, a tuple of matrices, biases (layers, out)
    of zeros, and the last matrix.
    """
    packed, last = matrices[0].back, matrices[1]
    of_slices, of_middle, of_biases, of_last = found
    layers, count, out = hidden.shape
    size, square, part, chunk = count * out, out * out, SIDE * out, _TOGETHER * SIDE
    last_rows = aligned_bits(part)
    _pack_last_rows(last, last_rows.view(np.uint32))
    ends = _pack_gradients(gradient, groups[0])
    turned, turned_ends = aligned_bits(size), aligned_bits(chunk * SIDE)
    others, pairs = _rows(layers, chunk * out), _rows(layers, chunk * out)  # by layer; `others` has no first
    both, work, sums = aligned_bits(2 * part), aligned_bits(2 * TILE * out).view(np.uint32), aligned_floats(BLOCK)
    end_blocks, blocks = aligned_floats(part), aligned_floats(layers * square).reshape((layers, square))
    use_units()
    for start in range(0, count, chunk):
        together = min(_TOGETHER, (count - start) // SIDE)
        for group in range(together):
            begin, here = start + group * SIDE, 0
            for layer in range(layers):
                pair_group(hidden, layer * size + begin * out, out, pairs[layer].view(np.uint32), group, _TOGETHER)
            of_ends = turned_ends.view(np.uint32)
            turn_lines(ends, begin * ENDS + SIDE, ENDS, SIDE, work, of_ends, group, _TOGETHER)
            for column in range(0, out, SIDE):
                clear_sums()
                add_lines(ends, begin * ENDS, ENDS, SIDE, last_rows, column * SIDE)
                store_sums(sums, 0, SIDE)
                write_masked(sums, hidden, (layers - 1) * size + begin * out + column, out, both, column)
            for layer in range(layers - 1, 0, -1):
                add_columns(both, here, out, of_biases, layer * out)
                turn_lines(both, here, out, out, work, others[layer].view(np.uint32), group, _TOGETHER)
                before, below = (layer - 1) * size + begin * out, part - here
                for column in range(0, out, SIDE):
                    clear_sums()
                    add_lines(both, here, out, out, packed, (layer - 1) * square + column * out)
                    store_sums(sums, 0, SIDE)
                    write_masked(sums, hidden, before + column, out, both, below + column)
                here = below
            add_columns(both, here, out, of_biases, 0)
            turn_lines(both, here, out, out, work, turned.view(np.uint32), begin // SIDE, count // SIDE)
        listed = np.arange(together)
        for layer in range(1, layers):
            add_groups(others[layer], listed, out, pairs[layer - 1], out, blocks[layer], start > 0)
        add_groups(turned_ends, listed, SIDE, pairs[layers - 1], out, end_blocks, start > 0)
    _sum_over_pairs(turned, bits, groups, of_slices)
    leave_units()
    for layer in range(1, layers):
        write_blocks(blocks[layer], out, out, of_middle[layer - 1])
    _write_last_gradient(end_blocks, of_last)


@device
def _rows(count, numbers):  # type: ignore[no-untyped-def]
    """Memory for `count` times so many numbers of bfloat16."""
    return aligned_bits(count * numbers).reshape((count, numbers))


@device
def _pack_last_rows(last, packed):  # type: ignore[no-untyped-def]
    """Pack the last matrix (codes, out) as the 32 rows that `_pack_gradients` is for."""
    codes, out = last.shape
    rows = np.zeros((SIDE, out), np.float32)
    for code in range(codes):
        for k in range(out):
            first = wide_value(narrow_bits(last[code, k]))
            rows[code, k] = rows[2 * codes + code, k] = first
            rows[codes + code, k] = last[code, k] - first
    pack_rows(rows, 0, (0, SIDE), SIDE, out, packed, 0)


@device
def _pack_gradients(gradient, order):  # type: ignore[no-untyped-def]
    """Gradients of codes (corners, codes) by line, (lines, 64), as parts of bfloat16 that add up to them.

    Of the first 32 numbers two codes' worth are the first part, and the third is the second part: times the rows of
    `_pack_last_rows` that makes products right to 16 bits, of which 8 are kept. The other 32 are all three parts.
    """
    codes = gradient.shape[1]
    flat = aligned_bits(len(order) * ENDS)
    flat[:] = 0
    packed = flat.reshape((len(order), ENDS))
    for line in range(len(order)):
        for code in range(codes if order[line] >= 0 else 0):
            rest = gradient[order[line], code]
            first = narrow_bits(rest)
            rest -= wide_value(first)
            second = narrow_bits(rest)
            packed[line, code] = packed[line, codes + code] = packed[line, SIDE + code] = first
            packed[line, 2 * codes + code] = packed[line, SIDE + codes + code] = second
            packed[line, SIDE + 2 * codes + code] = narrow_bits(rest - wide_value(second))
    return flat


@lean_device
def _write_last_gradient(blocks, of_last):  # type: ignore[no-untyped-def]
    """Write the gradient (codes, out) of the last matrix, of blocks of (32, out) that hold its three parts."""
    codes, out = of_last.shape
    for code in range(codes):
        for k in range(out):
            at = k // SIDE * BLOCK + k % SIDE
            parts = blocks[at + code * SIDE] + blocks[at + (codes + code) * SIDE]
            of_last[code, k] = parts + blocks[at + (2 * codes + code) * SIDE]


@device
def _sum_over_pairs(turned, bits, groups, of_slices):  # type: ignore[no-untyped-def]
    """Write the gradient (8, B, out) of the slices: blocks times turned gradients of the first layer's sums."""
    _, rows, octants = groups
    values, out = bits.shape[1], of_slices.shape[2]
    pairs, blocks = aligned_bits(_TOGETHER * SIDE * values), aligned_floats(out * values)
    words, nothing = pairs.view(np.uint32), np.zeros(values, np.uint16)
    for s in range(SLICES):
        listed = np.flatnonzero(octants >> s & 1)
        if len(listed) == 0:
            of_slices[s] = 0
            continue
        for first in range(0, len(listed), _TOGETHER):
            these = listed[first : first + _TOGETHER]
            for number in range(len(these)):
                _pair_blocks(bits, rows, these[number] * SIDE, s, nothing, words, number)
            add_groups(turned, these, out, pairs, values, blocks, first > 0)
        found = of_slices.view(np.uint32)
        write_turned_blocks(blocks.view(np.uint32), out, values, found, s * values * out)


@lean_device
def _pair_blocks(bits, rows, begin, s, nothing, words, number):  # type: ignore[no-untyped-def]
    """Write the blocks of 32 corners in an octant, zeros for none, as a right factor."""
    values = bits.shape[1]
    for pair in range(TILE):
        upper, lower = rows[begin + 2 * pair, s], rows[begin + 2 * pair + 1, s]
        if upper >= 0 and lower >= 0:
            pair_lines(bits, upper * values, bits, lower * values, values, words, pair, number, _TOGETHER)
        elif upper >= 0:
            pair_lines(bits, upper * values, nothing, 0, values, words, pair, number, _TOGETHER)
        elif lower >= 0:
            pair_lines(nothing, 0, bits, lower * values, values, words, pair, number, _TOGETHER)
        else:
            pair_lines(nothing, 0, nothing, 0, values, words, pair, number, _TOGETHER)
