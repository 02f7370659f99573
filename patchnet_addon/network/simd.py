# SPDX-License-Identifier: GPL-3.0-or-later
"""Vectors of float32 of one or a few SIMD registers, and their operations in matrix products.

The compiler vectorizes loops over columns, but does not keep a block of sums in registers, which a fast matrix product
needs. So a kernel uses explicit vectors. Indices are flat, into C-ordered arrays, and unchecked.
"""

from __future__ import annotations

from typing import Any

from llvmlite import binding, ir
from numba.core import types
from numba.extending import intrinsic

from ..runtime.vectors import VectorType, array_address, build_splat


def _lanes() -> int:
    """16 with 512-bit registers, else 8; a processor with smaller ones uses several for a vector."""
    try:
        return 16 if binding.get_host_cpu_features().get("avx512f") else 8
    except RuntimeError:  # unknown to LLVM
        return 8


LANES = _lanes()
WIDE_LANES = 4 * LANES if LANES == 16 else 2 * LANES
"""Lanes of a wide vector: the sums of six of them fit into the processor's registers."""

_INDEX = ir.IntType(32)


_LANES = VectorType(types.float32, LANES)
_WIDE = VectorType(types.float32, WIDE_LANES)
_SIXTEEN = VectorType(types.float32, 16)

HALF_SCALE = 2.0**112
"""Scale of `load_halves`: the ratio of the smallest half float to a float32 of the same bits."""


@intrinsic
def load(_typing: Any, array: Any, _index: Any) -> Any:
    """Vector of the elements from an index on: load(array, index)."""
    return _LANES(array, types.intp), _build_load


@intrinsic
def load_wide(_typing: Any, array: Any, _index: Any) -> Any:
    """Wide vector of the elements from an index on: load_wide(array, index)."""
    return _WIDE(array, types.intp), _build_load


def _build_load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    address = array_address(context, builder, signature, *arguments)
    vector = builder.load(builder.bitcast(address, signature.return_type.ir.as_pointer()))
    vector.align = 4
    return vector


@intrinsic
def zeros(_typing: Any) -> Any:
    """Vector of zeros: zeros()."""

    def build(_context: Any, _builder: Any, _signature: Any, _arguments: Any) -> Any:
        return ir.Constant(_LANES.ir, None)

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
    element = builder.load(array_address(context, builder, signature, *arguments))
    return build_splat(builder, signature.return_type, element)


@intrinsic
def add_product(_typing: Any, total: Any, left: Any, right: Any) -> Any:
    """Vector total + left * right, rounded once where the processor can: add_product(total, left, right)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        total, left, right = arguments
        return builder.fadd(total, builder.fmul(left, right, flags=("contract",)), flags=("contract",))

    return total(total, left, right), build


@intrinsic
def load_halves(_typing: Any, array: Any, _first: Any, _second: Any) -> Any:
    """Vector of 16 half floats / `HALF_SCALE`: load_halves(array, first, second).

    Eight begin at the first index, eight at the second, in an array of int16. The bits of a half float, shifted to
    those of a float32, give a value too small by this factor; infinities become numbers. So shifts suffice, and
    processors without half floats have the same bits.
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
        bits = builder.and_(bits, ir.Constant(integers, [0x8FFFFFFF] * 16))  # without the sign's copies
        return builder.bitcast(bits, _SIXTEEN.ir)

    return _SIXTEEN(array, types.intp, types.intp), build
