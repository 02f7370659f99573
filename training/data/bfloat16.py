# SPDX-License-Identifier: GPL-3.0-or-later
"""Bits of bfloat16 as uint16, which NumPy and numba have no type for: to float32 and back, in kernels.

One by one, and as vectors of `LANES` numbers, whose indices are flat and not checked, as in `vectors.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from ...patchnet_addon.runtime.kernels import device
from ...patchnet_addon.runtime.vectors import LANES, VectorType, array_address

_FLOATS = VectorType(types.float32, LANES)
_HALVES, _WORDS = (ir.VectorType(ir.IntType(bits), LANES) for bits in (16, 32))


@device
def wide_value(bits):
    """Float32 of the bits of a bfloat16."""
    return np.uint32(np.uint32(bits) << np.uint32(16)).view(np.float32)


@device
def narrow_bits(value):
    """Bits of the bfloat16 nearest to a finite float32, of two that are as near the even one, as uint16."""
    whole = np.float32(value).view(np.uint32)
    return np.uint16(np.uint32(whole + np.uint32(0x7FFF) + ((whole >> np.uint32(16)) & np.uint32(1))) >> np.uint32(16))


@intrinsic
def load_bfloat(_typing: Any, array: Any, _index: Any) -> Any:
    """Vector of float32 of the bits of bfloat16 from an index on: load_bfloat(array, index)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = _load_words(builder, array_address(context, builder, signature, *arguments))
        return builder.bitcast(builder.shl(words, _constant(16)), _FLOATS.ir)

    return _FLOATS(array, types.intp), build


@intrinsic
def store_bfloat(_typing: Any, array: Any, _index: Any, vector: Any) -> Any:
    """Store a vector of finite float32 as bits of bfloat16, rounded as by `narrow_bits`: (array, index, vector)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = array_address(context, builder, signature, *arguments[:2])
        bits = builder.trunc(_rounded(builder, arguments[2]), _HALVES)
        builder.store(bits, builder.bitcast(address, _HALVES.as_pointer())).align = 2
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), build


@intrinsic
def store_pairs(_typing: Any, array: Any, _index: Any, first: Any, second: Any) -> Any:
    """Store bits of two vectors, of a lane side by side in one uint32: store_pairs(array, index, first, second)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = array_address(context, builder, signature, *arguments[:2])
        low, high = (_rounded(builder, vector) for vector in arguments[2:])
        _store_words(builder, address, builder.or_(low, builder.shl(high, _constant(16))))
        return context.get_dummy_value()

    return types.void(array, types.intp, first, second), build


@intrinsic
def pair_bits(_typing: Any, array: Any, _index: Any, first: Any, _of_first: Any, second: Any, _of_second: Any) -> Any:
    """Store bits of two arrays side by side in one array of uint32: (array, index, first, its index, second, its)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        def address(argument: int) -> Any:
            data = context.make_array(signature.args[argument])(context, builder, arguments[argument]).data
            return builder.gep(data, [arguments[argument + 1]])

        low, high = (_load_words(builder, address(argument)) for argument in (2, 4))
        _store_words(builder, address(0), builder.or_(low, builder.shl(high, _constant(16))))
        return context.get_dummy_value()

    return types.void(array, types.intp, first, types.intp, second, types.intp), build


@intrinsic
def copy_bits(_typing: Any, array: Any, _index: Any, source: Any, _of_source: Any) -> Any:
    """Copy two vectors' worth of bits, uint16, from one array into another: (array, index, source, its index)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.VectorType(ir.IntType(16), 2 * LANES).as_pointer()
        to, of = (
            builder.gep(context.make_array(signature.args[k])(context, builder, arguments[k]).data, [arguments[k + 1]])
            for k in (0, 2)
        )
        bits = builder.load(builder.bitcast(of, kind))
        bits.align = 2
        builder.store(bits, builder.bitcast(to, kind)).align = 2
        return context.get_dummy_value()

    return types.void(array, types.intp, source, types.intp), build


def _constant(number: int) -> ir.Constant:
    return ir.Constant(_WORDS, [number] * LANES)


def _load_words(builder: Any, address: Any) -> Any:
    """Build a load of as many uint16 as there are lanes, as uint32."""
    halves = builder.load(builder.bitcast(address, _HALVES.as_pointer()))
    halves.align = 2
    return builder.zext(halves, _WORDS)


def _store_words(builder: Any, address: Any, words: Any) -> None:
    builder.store(words, builder.bitcast(address, _WORDS.as_pointer())).align = 4


def _rounded(builder: Any, vector: Any) -> Any:
    """Build the bits of the nearest bfloat16, the even one of two, in the lower half of each uint32."""
    whole = builder.bitcast(vector, _WORDS)
    odd = builder.and_(builder.lshr(whole, _constant(16)), _constant(1))
    return builder.lshr(builder.add(builder.add(whole, _constant(0x7FFF)), odd), _constant(16))
