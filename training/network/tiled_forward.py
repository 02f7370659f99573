# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernel of the encoder forward in matrix units, see `tiled_encoder.py`."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.aligned_memory import aligned_bits, aligned_floats
from ...patchnet_addon.runtime.kernels import device, kernel, lean_device
from ..data.bfloat16 import narrow_bits, wide_value
from .corner_layer import SLICES
from .matrix_units import SIDE, clear_sums, leave_units, load_sums, store_sums, use_units
from .tiled_packing import pack_rows
from .tiled_products import TILE, add_lines, copy_line, write_relu

ENDS = 2 * SIDE  # columns of what stands for codes
_SIDE_BY_SIDE = 4  # groups of 32 corners that meet a slice of the first matrix while a part of it lies in the cache
_PARTS = 3  # numbers of bfloat16 that make a float32


@kernel
def encode_groups(bits, pairs, parameters, groups, hidden, codes):  # type: ignore[no-untyped-def]
    """Group the corners, and write values of all layers into `hidden` (layers, lines, out) and their codes.

    parameters: `Packed`, biases (layers, out), and the last matrix (codes, out) and its bias.
    groups: order (lines,) int32 corner of each line, -1 for none; rows (lines, 8) int32 of `bits`, -1 for none; octants
    (lines / 32,) int32, as bits, in which a corner of a group has a block.
    """
    order, rows, octants = groups
    packed, biases, last, of_last = parameters
    first, others = packed.slices, packed.forward
    _group_corners(pairs, order, rows, octants, len(codes))
    values, middle, out = bits.shape[1], hidden.shape[0] - 1, hidden.shape[2]
    size, square, of_octant = hidden.shape[1] * out, out * out, values * out
    parts = aligned_bits(out * ENDS)
    _pack_last(last, parts.view(np.uint32))
    lines, nothing = aligned_bits(_SIDE_BY_SIDE * SIDE * values), np.zeros(values, np.uint16)
    sums, ends = aligned_floats(_SIDE_BY_SIDE * SIDE * out), _ends()
    flat = ends.reshape(-1)
    use_units()
    for start in range(0, len(octants), _SIDE_BY_SIDE):
        together = min(_SIDE_BY_SIDE, len(octants) - start)
        begun = 0  # bits of groups that have sums
        for s in range(SLICES):
            here = _copy_blocks(bits, groups, start, together, s, nothing, lines)
            for column in range(0, out if here else 0, SIDE):
                for group in range(together):
                    if here >> group & 1:
                        place = group * SIDE * out + column * SIDE
                        if begun >> group & 1:
                            load_sums(sums, place, SIDE)
                        else:
                            clear_sums()
                        left = group * SIDE * values
                        add_lines(lines, left, values, values, first, s * of_octant + column * values)
                        store_sums(sums, place, SIDE)
            begun |= here
        for group in range(together):
            begin = (start + group) * SIDE
            if not begun >> group & 1:
                sums[group * SIDE * out : (group + 1) * SIDE * out] = 0
            for column in range(0, out, SIDE):
                write_relu(sums, (group * out + column) * SIDE, biases, column, hidden, begin * out + column, out)
        for begin in range(start * SIDE, (start + together) * SIDE, SIDE):
            for layer in range(middle):
                below = layer * size + begin * out
                for column in range(0, out, SIDE):
                    clear_sums()
                    add_lines(hidden, below, out, out, others, layer * square + column * out)
                    store_sums(sums, 0, SIDE)
                    write_relu(sums, 0, biases, (layer + 1) * out + column, hidden, below + size + column, out)
            for column in range(0, ENDS, SIDE):
                clear_sums()
                add_lines(hidden, middle * size + begin * out, out, out, parts, column * out)
                store_sums(flat, column, ENDS)
            _write_codes(ends, of_last, order, begin, codes)
    leave_units()


@device
def _ends():  # type: ignore[no-untyped-def]
    """Sums (32, 64) that make codes."""
    return aligned_floats(SIDE * ENDS).reshape((SIDE, ENDS))


@device
def _group_corners(pairs, order, rows, octants, corners):  # type: ignore[no-untyped-def]
    """List corners by the octants in which they have blocks, and these blocks, see `encode_groups`."""
    starts, pair_block, pair_corner = pairs
    blocks, have = np.full((corners, SLICES), -1, np.int32), np.zeros(corners, np.int32)
    for s in range(SLICES):
        for pair in range(starts[s], starts[s + 1]):
            blocks[pair_corner[pair], s] = pair_block[pair]
            have[pair_corner[pair]] |= 1 << s
    place = np.zeros((1 << SLICES) + 1, np.int64)
    for corner in range(corners):
        place[have[corner] + 1] += 1
    for k in range(1 << SLICES):
        place[k + 1] += place[k]
    order[:], rows[:], octants[:] = -1, -1, 0
    for corner in range(corners):
        line = place[have[corner]]
        place[have[corner]] += 1
        order[line] = corner
        octants[line // SIDE] |= have[corner]
        for s in range(SLICES):
            rows[line, s] = blocks[corner, s]


@device
def _pack_last(last, packed):  # type: ignore[no-untyped-def]
    """Pack the last matrix (codes, out) as three parts of bfloat16 that add up to its numbers, 16 columns each."""
    codes, out = last.shape
    columns = np.zeros((out, ENDS), np.float32)
    for code in range(codes):
        for k in range(out):
            rest = last[code, k]
            for part in range(_PARTS):
                columns[k, part * TILE + code] = wide_value(narrow_bits(rest))
                rest -= columns[k, part * TILE + code]
    pack_rows(columns, 0, (0, out), out, ENDS, packed, 0)


@lean_device
def _copy_blocks(bits, groups, start, together, s, nothing, lines):  # type: ignore[no-untyped-def]
    """Copy the blocks of some groups of corners in an octant, zeros for none; returns bits of the groups that have any.

    Lines of groups that have none stay as they are.
    """
    _, rows, octants = groups
    values, here = bits.shape[1], 0
    for group in range(together):
        if octants[start + group] >> s & 1 == 0:
            continue
        here |= 1 << group
        for line in range(SIDE):
            row, target = rows[(start + group) * SIDE + line, s], (group * SIDE + line) * values
            if row >= 0:
                copy_line(bits, row * values, values, lines, target)
            else:
                copy_line(nothing, 0, values, lines, target)
    return here


@lean_device
def _write_codes(ends, of_last, order, begin, codes):  # type: ignore[no-untyped-def]
    for line in range(SIDE):
        corner = order[begin + line]
        for k in range(codes.shape[1] if corner >= 0 else 0):
            parts = ends[line, k] + ends[line, TILE + k] + ends[line, 2 * TILE + k]
            codes[corner, k] = of_last[k] + parts
