# SPDX-License-Identifier: GPL-3.0-or-later
"""Products of the decoder's layers for kernels, forward and backward, over a tile of views that stays in the caches.

Sums of `ROWS` rows times up to three vectors of columns stay in registers, as in `product.py`. They are one block,
whose type says how many vectors a row has, since no one number divides the widths of all layers. Widths of arrays are
whole vectors and numbers of rows are multiples of `ROWS`: both are filled up with zeros. Indices are not checked.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.types.containers import UniTuple
from numba.extending import intrinsic

from ...patchnet_addon.network.lanes import LANES, spread
from ...patchnet_addon.runtime.kernels import device, lean_device
from ...patchnet_addon.runtime.vectors import VectorType, array_address, build_splat

ROWS = 8 if LANES == 16 else 4  # times three vectors: 24 registers of sums where there are 32, 12 where there are 16
_PANEL = 3  # vectors of a block at most

_VECTOR = VectorType(types.float32, LANES)
_INTEGER = ir.IntType(64)


@device
def filled(count, step):
    """Least multiple of `step` that is no less than `count`."""
    return (count + step - 1) // step * step


@lean_device
def apply_layer(values, depth, matrix, bias, least, result):
    """Write the first `depth` columns of values (n, ...) times a matrix (depth, ...), plus bias, to result (n, width).

    The first `width` columns of the matrix, and numbers of the bias, are used. least: (1,) what a result is at least,
    in memory, from where it is spread over a vector.
    """
    width, between, stride, low = result.shape[1], matrix.shape[1], values.shape[1], spread(least, 0)
    column = 0
    while column < width:
        vectors = _vectors_of_panel(width - column)
        for row in range(0, len(values), ROWS):
            at, left, right = row * width + column, (row * stride, stride), (column, between)
            if vectors == 3:
                three = _add_rows(_load_three(bias, column, 0), values, left, matrix, right, depth)
                _store_block(result, at, width, three, low)
            elif vectors == 2:
                two = _add_rows(_load_two(bias, column, 0), values, left, matrix, right, depth)
                _store_block(result, at, width, two, low)
            else:
                one = _add_rows(_load_one(bias, column, 0), values, left, matrix, right, depth)
                _store_block(result, at, width, one, low)
        column += vectors * LANES


@lean_device
def add_products(after, rows, values, least, result):
    """Add the first `rows` columns of after (n, ...), transposed, times values (n, width) to as many rows of a result.

    The first `width` columns of the result (rows, ...) are used. least: (1,) minus infinity.
    """
    depth, width = values.shape
    between, stride, low = result.shape[1], after.shape[1], spread(least, 0)
    column = 0
    while column < width:
        vectors = _vectors_of_panel(width - column)
        for row in range(0, rows, ROWS):
            at, left, right = row * between + column, (row, stride), (column, width)
            if vectors == 3:
                three = _add_columns(_load_three(result, at, between), after, left, values, right, depth)
                _store_block(result, at, between, three, low)
            elif vectors == 2:
                two = _add_columns(_load_two(result, at, between), after, left, values, right, depth)
                _store_block(result, at, between, two, low)
            else:
                one = _add_columns(_load_one(result, at, between), after, left, values, right, depth)
                _store_block(result, at, between, one, low)
        column += vectors * LANES


@lean_device
def _vectors_of_panel(columns):
    """Vectors that are taken of so many columns at once: three, or two of four, since one alone is slow."""
    vectors = columns // LANES
    return 2 if vectors == _PANEL + 1 else min(vectors, _PANEL)


def _loading(vectors: int) -> Any:
    def typing(_typing: Any, array: Any, _index: Any, _stride: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            array, index, stride = arguments
            loaded = []
            for _ in range(ROWS):
                loaded += _build_loads(builder, array_address(context, builder, signature, array, index), vectors)
                index = builder.add(index, stride)
            return _build_block(builder, loaded)

        return _block(vectors)(array, types.intp, types.intp), build

    return typing


# Block of the vectors from an index on, rows `stride` elements apart: load(array, index, stride).
_load_one, _load_two, _load_three = (intrinsic(_loading(vectors)) for vectors in range(1, _PANEL + 1))


@intrinsic
def _store_block(_typing: Any, array: Any, _index: Any, _stride: Any, block: Any, least: Any) -> Any:
    """Store a block, at least the vector `least`: _store_block(array, index, stride, block, least)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, stride, block, least = arguments
        vectors = signature.args[3].count // ROWS
        for row in range(ROWS):
            address = array_address(context, builder, signature, array, index)
            pointer = builder.bitcast(address, _VECTOR.ir.as_pointer())
            for k in range(vectors):
                value = builder.extract_value(block, row * vectors + k)
                value = builder.select(builder.fcmp_ordered("<", value, least), least, value)  # what is no number stays
                builder.store(value, builder.gep(pointer, [_INTEGER(k)])).align = 4
            index = builder.add(index, stride)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, block, least), build


def _adding(*, across: bool) -> Any:
    def typing(_typing: Any, block: Any, left: Any, _left_at: Any, right: Any, _right_at: Any, _depth: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            left_data, right_data = (
                context.make_array(signature.args[k])(context, builder, arguments[k]).data for k in (1, 3)
            )
            (at, stride), (right_at, width) = (
                [builder.extract_value(arguments[pair], k) for k in range(2)] for pair in (2, 4)
            )
            between_rows, between_terms = (_INTEGER(1), stride) if across else (stride, _INTEGER(1))
            rows = []
            for _ in range(ROWS):
                rows.append(builder.gep(left_data, [at]))
                at = builder.add(at, between_rows)
            first = builder.gep(right_data, [right_at])

            def add_term(term: Any, sums: list[Any]) -> list[Any]:
                vectors = _build_loads(builder, builder.gep(first, [builder.mul(term, width)]), len(sums) // ROWS)
                step = builder.mul(term, between_terms)
                values = [build_splat(builder, _VECTOR, builder.load(builder.gep(row, [step]))) for row in rows]
                products = [builder.fmul(value, each, flags=("contract",)) for value in values for each in vectors]
                return [builder.fadd(*both, flags=("contract",)) for both in zip(sums, products, strict=True)]

            sums = [builder.extract_value(arguments[0], k) for k in range(signature.args[0].count)]
            return _build_block(builder, _build_loop(builder, arguments[5], sums, add_term))

        pair = UniTuple(types.intp, 2)
        return block(block, left, pair, right, pair, types.intp), build

    return typing


# Block plus products of `ROWS` numbers of the left array with vectors of the right one, summed over `depth` terms:
# add(block, left, (index, stride), right, (index, width), depth). Rows of the right one are terms; those of the left
# one are rows of the block, or terms too.
_add_rows, _add_columns = intrinsic(_adding(across=False)), intrinsic(_adding(across=True))


def _block(vectors: int) -> Any:
    """Type of a block: its vectors, row after row."""
    return UniTuple(_VECTOR, ROWS * vectors)


def _build_block(builder: Any, vectors: list[Any]) -> Any:
    block = ir.Constant(ir.ArrayType(_VECTOR.ir, len(vectors)), ir.Undefined)
    for k, vector in enumerate(vectors):
        block = builder.insert_value(block, vector, k)
    return block


def _build_loads(builder: Any, address: Any, count: int) -> list[Any]:
    """Build loads of vectors one behind the other."""
    pointer = builder.bitcast(address, _VECTOR.ir.as_pointer())
    loads = [builder.load(builder.gep(pointer, [_INTEGER(k)])) for k in range(count)]
    for load in loads:
        load.align = 4
    return loads


def _build_loop(builder: Any, count: Any, values: list[Any], build_step: Any) -> list[Any]:
    """Build a loop that takes build_step(index, values) for values `count` times, at least once; returns the last."""
    before, loop = builder.block, builder.append_basic_block("terms")
    end = builder.append_basic_block("summed")
    builder.branch(loop)
    builder.position_at_end(loop)
    index, *carried = [builder.phi(kind) for kind in (_INTEGER, *(value.type for value in values))]
    following = build_step(index, carried)
    after = builder.add(index, _INTEGER(1))
    for phi, first, last in zip([index, *carried], [_INTEGER(0), *values], [after, *following], strict=True):
        phi.add_incoming(first, before)
        phi.add_incoming(last, loop)
    builder.cbranch(builder.icmp_signed("<", after, count), loop, end)
    builder.position_at_end(end)
    return following
