# SPDX-License-Identifier: GPL-3.0-or-later
"""Bit operations in kernels, one instruction each, on int64, uint64, or the int32 bits of a float."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_WORDS = types.int64, types.uint64


@intrinsic
def count_ones(_typing: Any, word: Any) -> Any:
    """Number of set bits of a word, as int64: count_ones(word)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return (types.int64(word), build) if word in _WORDS else None


@intrinsic
def lowest_one(_typing: Any, word: Any) -> Any:
    """Index of the lowest set bit of a word, as int64; 64 for a zero word: lowest_one(word)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return (types.int64(word), build) if word in _WORDS else None


@intrinsic
def float_of_bits(_typing: Any, word: Any) -> Any:
    """float32 with the bits of an int32: float_of_bits(word)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.FloatType())

    return (types.float32(word), build) if word == types.int32 else None
