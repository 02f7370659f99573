# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a training step in matrix units: how numbers are put for them, and products of 32 lines with what follows.

For the kernels of `tiled_forward.py` and `tiled_backward.py`. All sums are float32, all factors bits of bfloat16.
Indices are flat, into C-ordered arrays, and sizes multiples of 32.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.kernels import lean_device
from ...patchnet_addon.runtime.vectors import LANES, larger, less, load, select, splat, store
from ..data.bfloat16 import copy_bits, load_bfloat, pair_bits, store_bfloat
from .matrix_units import SIDE, add_products, clear_sums, load_sums, store_sums, transpose_words

TILE = 16  # columns of a tile of pairs, and lines of one of values
BLOCK = SIDE * SIDE  # numbers of a block


@lean_device
def add_lines(left, top, step, depth, right, begin):
    """Add to the block of sums the products of 32 lines, `step` numbers apart, and 32 columns, see `Packed`."""
    bottom, second = top + TILE * step, begin + TILE * depth
    for k in range(0, depth, SIDE):
        add_products(left, top + k, bottom + k, step, right, begin + k * TILE, second + k * TILE)


@lean_device
def write_relu(sums, at, biases, column, result, to, step):
    """Write ReLU of a block of sums (32, 32) from `at` on and biases, rounded, into 32 lines, `step` numbers apart."""
    zero = splat(np.float32(0))
    for half in range(0, SIDE, LANES):
        added = load(biases, column + half)
        for line in range(SIDE):
            value = larger(load(sums, at + line * SIDE + half) + added, zero)
            store_bfloat(result, to + line * step + half, value)


@lean_device
def write_masked(sums, values, begin, step, result, to):
    """Write sums (32, 32) where 32 lines of `values` are not 0, and 0 elsewhere, rounded; `step` numbers apart both."""
    zero = splat(np.float32(0))
    for line in range(SIDE):
        for half in range(0, SIDE, LANES):
            there = less(zero, load_bfloat(values, begin + line * step + half))
            value = select(there, load(sums, line * SIDE + half), zero)
            store_bfloat(result, to + line * step + half, value)


@lean_device
def add_columns(lines, begin, out, totals, to):
    """Add the sums of the columns of 32 lines of `out` numbers to `totals`."""
    for k in range(0, out, LANES):
        total = load(totals, to + k)
        for line in range(SIDE):
            total = total + load_bfloat(lines, begin + line * out + k)
        store(totals, to + k, total)


@lean_device
def copy_line(source, begin, values, target, to):
    """Copy `values` bits of bfloat16."""
    for k in range(0, values, SIDE):
        copy_bits(target, to + k, source, begin + k)


@lean_device
def turn_lines(lines, begin, step, columns, work, turned, group, groups):
    """Write columns of 32 lines, `step` numbers apart, as lines of 32: the left factor of a group, see `add_groups`.

    work: (16 columns,) and turned: uint32.
    """
    for pair in range(TILE):
        upper = begin + 2 * pair * step
        for k in range(0, columns, LANES):
            pair_bits(work, pair * columns + k, lines, upper + k, lines, upper + step + k)
    for column in range(0, columns, TILE):
        transpose_words(work, column, columns, turned, _place(column, group, groups), TILE)


@lean_device
def _place(column, group, groups):
    """Index of a group's tile of 16 columns in uint32."""
    return (column // SIDE * groups + group) * BLOCK // 2 + column % SIDE * TILE


@lean_device
def pair_lines(first, upper, second, lower, values, pairs, line, group, groups):
    """Write two lines of `values` numbers as one of each tile of the right factor of a group; pairs: uint32."""
    for k in range(0, values, TILE):
        pair_bits(pairs, _place(k, group, groups) + line * TILE, first, upper + k, second, lower + k)


@lean_device
def pair_group(lines, begin, out, pairs, group, groups):
    """Write 32 lines of `out` numbers, one after the other, as the right factor of a group; pairs: uint32."""
    for pair in range(TILE):
        upper = begin + 2 * pair * out
        pair_lines(lines, upper, lines, upper + out, out, pairs, pair, group, groups)


@lean_device
def add_groups(turned, listed, out, pairs, values, result, more):
    """Write products of turned and paired lines of groups as blocks (out / 32, values / 32) of 32 x 32 sums.

    turned: blocks (out / 32, groups) of 32 lines of 32. listed: those of the groups that are meant. pairs: blocks
    (values / 32, groups) of two tiles of pairs, those that are meant first. more: add to the blocks that are there.
    That what is read for one block of sums lies together matters: lines of a whole matrix or group are so far apart
    that they fall onto the same lines of the cache.
    """
    half, of_left, of_right = BLOCK // 2, len(turned) // (out // SIDE), len(pairs) // (values // SIDE)
    for top in range(0, out, SIDE):
        for column in range(0, values, SIDE):
            place = top * values + column * SIDE
            if more:
                load_sums(result, place, SIDE)
            else:
                clear_sums()
            for number in range(len(listed)):
                upper = top // SIDE * of_left + listed[number] * BLOCK
                begin = column // SIDE * of_right + number * BLOCK
                add_products(turned, upper, upper + half, SIDE, pairs, begin, begin + half)
            store_sums(result, place, SIDE)


@lean_device
def write_blocks(blocks, out, values, result):
    """Write blocks of sums, as `add_groups` leaves them, as lines of a matrix (out, values)."""
    for top in range(0, out, SIDE):
        for column in range(0, values, SIDE):
            at = top * values + column * SIDE
            for line in range(SIDE):
                target = (top + line) * values + column
                store(result, target, load(blocks, at + line * SIDE))
                store(result, target + LANES, load(blocks, at + line * SIDE + LANES))


@lean_device
def write_turned_blocks(blocks, out, values, result, to):
    """Write the same as columns: a matrix (values, out); all are given as uint32."""
    for column in range(0, values, TILE):
        for top in range(0, out, TILE):
            block = top // SIDE * SIDE * values + column // SIDE * BLOCK
            inside = top % SIDE * SIDE + column % SIDE
            transpose_words(blocks, block + inside, SIDE, result, to + column * out + top, out)
