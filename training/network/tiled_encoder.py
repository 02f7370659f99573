# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder of a batch in the processor's matrix units, forward and backward, by one kernel each.

What `CpuEncoder` and the last layer after it do by torch's products of bfloat16, which read and write all values of a
layer once more for each step in between. Here 32 corners go through all layers while what they are lies in the
processor's nearest caches, and biases, ReLUs and rounding are done where the sums of a product are. Corners are put in
the order of the octants in which they have blocks: then the 32 of a group mostly have them in the same ones, and the
others are left out.

Products of bfloat16, all sums in float32, what a layer hands on rounded to bfloat16 once. Codes are products of float32
with that: a float32 is three numbers of bfloat16 that add up to it. The kernels are serial, since several threads learn
from a part of a step each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.runtime.kernels import device, kernel, lean_device
from ..data.bfloat16 import narrow_bits, wide_value
from .aligned_memory import aligned, aligned_bits, aligned_floats
from .corner_layer import SLICES
from .matrix_units import SIDE, clear_sums, leave_units, load_sums, matrix_units_usable, store_sums, use_units
from .tiled_products import (
    BLOCK,
    TILE,
    add_columns,
    add_groups,
    add_lines,
    copy_line,
    pack_columns,
    pack_rows,
    pair_group,
    pair_lines,
    turn_lines,
    write_blocks,
    write_masked,
    write_relu,
    write_turned_blocks,
)

_SIDE_BY_SIDE = 4  # groups of 32 corners that meet a slice of the first matrix while a part of it lies in the cache
_TOGETHER = 8  # groups whose pairs lie in the cache while the gradient of a matrix is summed over their corners
_PARTS = 3  # numbers of bfloat16 that make a float32
_ENDS = 2 * SIDE  # columns of what stands for codes


def takes(dtype: torch.dtype, values: int) -> bool:
    """Whether `TiledEncoder` can multiply blocks of so many values in this type here."""
    return dtype == torch.bfloat16 and values % SIDE == 0 and matrix_units_usable()


class TiledEncoder(torch.autograd.Function):
    """Codes (corners, 10) float32 of the occupied blocks of a batch; the gradient goes to the parameters."""

    @staticmethod
    def forward(
        ctx: Any,
        blocks: Tensor,
        starts: list[int],
        pair_block: Tensor,
        pair_corner: Tensor,
        corners: int,
        slices: Tensor,
        *layers: Tensor,
    ) -> Tensor:
        """Results of slices (8, B, out) and `layers`: a bias (out,), then matrices and biases in turn, float32.

        The last matrix (10, out) is multiplied in float32, those before, (out, out), and the slices in bfloat16. B and
        `out` are multiples of 32. The others are as in `TensorBatch`.
        """
        bits = blocks.to(torch.bfloat16).view(torch.int16).numpy().view(np.uint16)
        *biases, of_last = (each.detach().numpy() for each in layers[::2])
        *middle, last = (each.detach().numpy() for each in layers[1::2])
        lines = -(-corners // SIDE) * SIDE
        groups = np.empty(lines, np.int32), np.empty((lines, SLICES), np.int32), np.empty(lines // SIDE, np.int32)
        hidden, codes = aligned((len(biases), lines, slices.shape[2])), np.empty((corners, len(last)), np.float32)
        pairs = np.array(starts), pair_block.numpy(), pair_corner.numpy()
        parameters = slices.detach().numpy(), tuple(middle), np.stack(biases), last, of_last
        _encode(bits, pairs, parameters, groups, hidden, codes)
        ctx.save_for_backward(*layers[1::2])
        ctx.kept = bits, groups, hidden
        return torch.from_numpy(codes)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradients of slices, biases and matrices, float32."""
        *middle, last = (each.detach().numpy() for each in ctx.saved_tensors)
        bits, groups, hidden = ctx.kept
        layers, _, out = hidden.shape
        of_slices, of_last = torch.empty(SLICES, bits.shape[1], out), torch.empty(last.shape)
        of_middle, of_biases = torch.empty(len(middle), out, out), torch.zeros(layers, out)
        found = of_slices.numpy(), of_middle.numpy(), of_biases.numpy(), of_last.numpy()
        _turn_back(bits, groups, (tuple(middle), last), hidden, gradient.numpy(), found)
        matrices = [*of_middle.unbind(), of_last]
        of_layers = [part for pair in zip(matrices, [*of_biases[1:], gradient.sum(0)], strict=True) for part in pair]
        return None, None, None, None, None, of_slices, of_biases[0], *of_layers


class _Rounded(torch.autograd.Function):
    """Numbers rounded to bfloat16; their gradient is handed on, rounded too where that is asked for."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, forward: bool, back: bool) -> Tensor:
        ctx.back = back
        return values.bfloat16().float() if forward else values.clone()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:  # type: ignore[override]
        return gradient.bfloat16().float() if ctx.back else gradient, None, None


def encode_reference(
    blocks: Tensor,
    starts: list[int],
    pair_block: Tensor,
    pair_corner: Tensor,
    corners: int,
    slices: Tensor,
    *layers: Tensor,
) -> Tensor:
    """Reference of `TiledEncoder` in torch, rounded where it rounds, with a gradient by autograd."""
    bias, *others, last, of_last = layers
    sums = torch.zeros(corners, slices.shape[2])
    for s in range(SLICES):
        blocks_here, corners_here = (part[starts[s] : starts[s + 1]] for part in (pair_block, pair_corner))
        products = blocks[blocks_here].float() @ _Rounded.apply(slices[s], True, False)
        sums = sums.index_add(0, corners_here, products)
    hidden = _relu_reference(sums + bias)
    for matrix, added in zip(others[::2], others[1::2], strict=True):
        hidden = _relu_reference(hidden @ _Rounded.apply(matrix, True, False).t() + added)
    return hidden @ last.t() + of_last


def _relu_reference(sums: Tensor) -> Tensor:
    rounded_back: Tensor = _Rounded.apply(sums, False, True)
    result: Tensor = _Rounded.apply(torch.relu(rounded_back), True, False)
    return result


@kernel
def _encode(bits, pairs, parameters, groups, hidden, codes):  # type: ignore[no-untyped-def]
    """Group the corners, and write values of all layers into `hidden` (layers, lines, out) and their codes.

    groups: order (lines,) int32 corner of each line, -1 for none; rows (lines, 8) int32 of `bits`, -1 for none; octants
    (lines / 32,) int32, as bits, in which a corner of a group has a block.
    """
    order, rows, octants = groups
    slices, middle, biases, last, of_last = parameters
    _group_corners(pairs, order, rows, octants, len(codes))
    values, out = slices.shape[1], slices.shape[2]
    size, square, of_octant = hidden.shape[1] * out, out * out, values * out
    first, others = aligned_bits(SLICES * of_octant), aligned_bits(len(middle) * square)
    work, parts = aligned_bits(TILE * out), aligned_bits(out * _ENDS)
    for s in range(SLICES):
        pack_rows(slices, s * of_octant, values, out, first.view(np.uint32), s * of_octant // 2)
    for layer in range(len(middle)):
        pack_columns(middle[layer], out, out, work, others.view(np.uint32), layer * square // 2)
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
            for layer in range(len(middle)):
                below = layer * size + begin * out
                for column in range(0, out, SIDE):
                    clear_sums()
                    add_lines(hidden, below, out, out, others, layer * square + column * out)
                    store_sums(sums, 0, SIDE)
                    write_relu(sums, 0, biases, (layer + 1) * out + column, hidden, below + size + column, out)
            for column in range(0, _ENDS, SIDE):
                clear_sums()
                add_lines(hidden, len(middle) * size + begin * out, out, out, parts, column * out)
                store_sums(flat, column, _ENDS)
            _write_codes(ends, of_last, order, begin, codes)
    leave_units()


@device
def _ends():  # type: ignore[no-untyped-def]
    """Sums (32, 64) that make codes."""
    return aligned_floats(SIDE * _ENDS).reshape((SIDE, _ENDS))


@device
def _group_corners(pairs, order, rows, octants, corners):  # type: ignore[no-untyped-def]
    """List corners by the octants in which they have blocks, and these blocks, see `_encode`."""
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
    columns = np.zeros((out, _ENDS), np.float32)
    for code in range(codes):
        for k in range(out):
            rest = last[code, k]
            for part in range(_PARTS):
                columns[k, part * TILE + code] = wide_value(narrow_bits(rest))
                rest -= columns[k, part * TILE + code]
    pack_rows(columns, 0, out, _ENDS, packed, 0)


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


@kernel
def _turn_back(bits, groups, matrices, hidden, gradient, found):  # type: ignore[no-untyped-def]
    """Write the gradients of all parameters but the last bias, of that of codes (corners, codes)."""
    middle, last = matrices
    of_slices, of_middle, of_biases, of_last = found
    layers, count, out = hidden.shape
    size, square, part, chunk = count * out, out * out, SIDE * out, _TOGETHER * SIDE
    packed, last_rows = aligned_bits((layers - 1) * square), aligned_bits(part)
    for layer in range(layers - 1):
        pack_rows(middle[layer], 0, out, out, packed.view(np.uint32), layer * square // 2)
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
            turn_lines(ends, begin * _ENDS + SIDE, _ENDS, SIDE, work, of_ends, group, _TOGETHER)
            for column in range(0, out, SIDE):
                clear_sums()
                add_lines(ends, begin * _ENDS, _ENDS, SIDE, last_rows, column * SIDE)
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
    pack_rows(rows, 0, SIDE, out, packed, 0)


@device
def _pack_gradients(gradient, order):  # type: ignore[no-untyped-def]
    """Gradients of codes (corners, codes) by line, (lines, 64), as parts of bfloat16 that add up to them.

    Of the first 32 numbers two codes' worth are the first part, and the third is the second part: times the rows of
    `_pack_last_rows` that makes products right to 16 bits, of which 8 are kept. The other 32 are all three parts.
    """
    codes = gradient.shape[1]
    flat = aligned_bits(len(order) * _ENDS)
    flat[:] = 0
    packed = flat.reshape((len(order), _ENDS))
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
