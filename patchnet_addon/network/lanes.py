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

_VECTOR = ir.VectorType(ir.FloatType(), LANES)
_INDEX = ir.IntType(32)


class LanesType(types.Type):  # type: ignore[misc]
    """Numba's type of a vector."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes({LANES})")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: LanesType) -> None:
        super().__init__(manager, kind, _VECTOR)


_LANES = LanesType()


@intrinsic
def load(_typing: Any, array: Any, _index: Any) -> Any:
    """Vector of the elements from an index on: load(array, index)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _address(context, builder, signature, *arguments)
        vector = builder.load(builder.bitcast(address, _VECTOR.as_pointer()))
        vector.align = 4
        return vector

    return _LANES(array, types.intp), build


@intrinsic
def store(_typing: Any, array: Any, _index: Any, _vector: Any) -> Any:
    """Store a vector from an index on: store(array, index, vector); nothing is returned."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _address(context, builder, signature, *arguments[:2])
        builder.store(arguments[2], builder.bitcast(address, _VECTOR.as_pointer())).align = 4
        return context.get_dummy_value()

    return types.void(array, types.intp, _LANES), build


@intrinsic
def zeros(_typing: Any) -> Any:
    """Vector of zeros: zeros()."""

    def build(_context: Any, _builder: Any, _signature: Any, _arguments: Any) -> Any:
        return ir.Constant(_VECTOR, None)

    return _LANES(), build


@intrinsic
def spread(_typing: Any, array: Any, _index: Any) -> Any:
    """Vector of one element in every lane: spread(array, index)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        element = builder.load(_address(context, builder, signature, *arguments))
        nothing = ir.Constant(_VECTOR, ir.Undefined)
        first = builder.insert_element(nothing, element, _INDEX(0))
        return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, LANES), None))

    return _LANES(array, types.intp), build


@intrinsic
def add(_typing: Any, _left: Any, _right: Any) -> Any:
    """Vector left + right: add(left, right)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fadd(*arguments)

    return _LANES(_LANES, _LANES), build


@intrinsic
def add_product(_typing: Any, _total: Any, _left: Any, _right: Any) -> Any:
    """Vector total + left * right, rounded once where the processor can: add_product(total, left, right)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        total, left, right = arguments
        return builder.fadd(total, builder.fmul(left, right, flags=("contract",)), flags=("contract",))

    return _LANES(_LANES, _LANES, _LANES), build


@intrinsic
def at_least(_typing: Any, _vector: Any, _least: Any) -> Any:
    """Vector of the larger of two, lane by lane; what is not a number stays: at_least(vector, least)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        vector, least = arguments
        return builder.select(builder.fcmp_ordered("<", vector, least), least, vector)

    return _LANES(_LANES, _LANES), build


def _address(context: Any, builder: Any, signature: Any, array: Any, index: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, array).data
    return builder.gep(data, [index])
