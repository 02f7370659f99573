# SPDX-License-Identifier: GPL-3.0-or-later
"""Vectors of float32 in kernels: a value that fills one SIMD register, and the few things that products do with it.

The compiler makes vectors of loops over columns by itself, but it keeps no block of sums in registers meanwhile, and a
fast matrix product is made of that. So a kernel names the vectors that are to stay. Indices are flat, into C-ordered
arrays, and are not checked.
"""

from __future__ import annotations

from typing import Any

from llvmlite import binding, ir
from numba.core import types
from numba.extending import intrinsic, models, register_model


def _lanes() -> int:
    """16 where registers have 512 bits, else 8; a processor with smaller ones takes two or more for a vector."""
    try:
        return 16 if binding.get_host_cpu_features().get("avx512f") else 8
    except RuntimeError:  # LLVM knows nothing about this processor
        return 8


LANES = _lanes()
WIDE_LANES = 4 * LANES if LANES == 16 else 2 * LANES
"""Lanes of a wide vector: so many registers' worth of it that the sums of six fit into the processor's registers."""

_INDEX = ir.IntType(32)


class LanesType(types.Type):  # type: ignore[misc]
    """Numba's type of a vector of some lanes; the compiler makes as many registers of it as it takes."""

    def __init__(self, lanes: int) -> None:
        super().__init__(name=f"Lanes({lanes})")
        self.lanes = lanes
        self.vector = ir.VectorType(ir.FloatType(), lanes)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: LanesType) -> None:
        super().__init__(manager, kind, kind.vector)


_LANES = LanesType(LANES)
_WIDE = LanesType(WIDE_LANES)
_SIXTEEN = LanesType(16)

HALF_SCALE = 2.0**112
"""Factor that `load_halves` leaves out: the ratio of the smallest half float to a float32 of the same bits."""


@intrinsic
def load(_typing: Any, array: Any, _index: Any) -> Any:
    """Vector of the elements from an index on: load(array, index)."""
    return _LANES(array, types.intp), _build_load


@intrinsic
def load_wide(_typing: Any, array: Any, _index: Any) -> Any:
    """Wide vector of the elements from an index on: load_wide(array, index)."""
    return _WIDE(array, types.intp), _build_load


def _build_load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    address = _address(context, builder, signature, *arguments)
    vector = builder.load(builder.bitcast(address, signature.return_type.vector.as_pointer()))
    vector.align = 4
    return vector


@intrinsic
def store(_typing: Any, array: Any, _index: Any, vector: Any) -> Any:
    """Store a vector from an index on: store(array, index, vector); nothing is returned."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _address(context, builder, signature, *arguments[:2])
        builder.store(arguments[2], builder.bitcast(address, vector.vector.as_pointer())).align = 4
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), build


@intrinsic
def zeros(_typing: Any) -> Any:
    """Vector of zeros: zeros()."""

    def build(_context: Any, _builder: Any, _signature: Any, _arguments: Any) -> Any:
        return ir.Constant(_LANES.vector, None)

    return _LANES(), build


@intrinsic
def spread(_typing: Any, array: Any, _index: Any) -> Any:
    """Vector of one element in every lane: spread(array, index)."""
    return _LANES(array, types.intp), _build_spread


@intrinsic
def spread_wide(_typing: Any, array: Any, _index: Any) -> Any:
    """Wide vector of one element in every lane: spread_wide(array, index)."""
    return _WIDE(array, types.intp), _build_spread


def _build_spread(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    element = builder.load(_address(context, builder, signature, *arguments))
    return _spread_element(builder, element, signature.return_type)


def _spread_element(builder: Any, element: Any, kind: LanesType) -> Any:
    nothing = ir.Constant(kind.vector, ir.Undefined)
    first = builder.insert_element(nothing, element, _INDEX(0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, kind.lanes), None))


@intrinsic
def add(_typing: Any, left: Any, right: Any) -> Any:
    """Vector left + right: add(left, right)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fadd(*arguments)

    return left(left, right), build


@intrinsic
def add_product(_typing: Any, total: Any, left: Any, right: Any) -> Any:
    """Vector total + left * right, rounded once where the processor can: add_product(total, left, right)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        total, left, right = arguments
        return builder.fadd(total, builder.fmul(left, right, flags=("contract",)), flags=("contract",))

    return total(total, left, right), build


@intrinsic
def at_least(_typing: Any, vector: Any, least: Any) -> Any:
    """Vector of the larger of two, lane by lane; what is not a number stays: at_least(vector, least)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        vector, least = arguments
        return builder.select(builder.fcmp_ordered("<", vector, least), least, vector)

    return vector(vector, least), build


@intrinsic
def multiply(_typing: Any, left: Any, right: Any) -> Any:
    """Vector left * right: multiply(left, right)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fmul(*arguments)

    return left(left, right), build


@intrinsic
def zeros_16(_typing: Any) -> Any:
    """Vector of 16 zeros: zeros_16()."""

    def build(_context: Any, _builder: Any, _signature: Any, _arguments: Any) -> Any:
        return ir.Constant(_SIXTEEN.vector, None)

    return _SIXTEEN(), build


@intrinsic
def fill_16(_typing: Any, value: Any) -> Any:
    """Vector of 16 times a number: fill_16(value)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _spread_element(builder, arguments[0], _SIXTEEN)

    return _SIXTEEN(value), build


@intrinsic
def load_halves(_typing: Any, array: Any, _first: Any, _second: Any) -> Any:
    """Vector of 16 half floats / `HALF_SCALE`: load_halves(array, first, second).

    Eight stand from the first index on, eight from the second on, in an array of int16. A half float with its bits at
    the places of a float32 is that much too small; infinities are not told from numbers. So it takes shifts alone, and
    processors that know no half floats have the same bits.
    """

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        eight = ir.VectorType(ir.IntType(16), 8)
        parts = []
        for index in arguments[1:]:
            address = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            parts.append(builder.load(builder.bitcast(builder.gep(address, [index]), eight.as_pointer())))
            parts[-1].align = 2
        integers = ir.VectorType(_INDEX, 16)
        both = builder.shuffle_vector(*parts, ir.Constant(integers, list(range(16))))
        bits = builder.shl(builder.sext(both, integers), ir.Constant(integers, [13] * 16))
        bits = builder.and_(bits, ir.Constant(integers, [0x8FFFFFFF] * 16))  # the sign stands at its place only
        return builder.bitcast(bits, _SIXTEEN.vector)

    return _SIXTEEN(array, types.intp, types.intp), build


def _address(context: Any, builder: Any, signature: Any, array: Any, index: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, array).data
    return builder.gep(data, [index])
