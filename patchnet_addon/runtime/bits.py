# SPDX-License-Identifier: GPL-3.0-or-later
"""Bits of a word in kernels, one instruction each."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic


@intrinsic
def count_ones(_typing: Any, _word: Any) -> Any:
    """Count the ones of a uint64, as int64: count_ones(word)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), build


@intrinsic
def lowest_one(_typing: Any, _word: Any) -> Any:
    """Place of the lowest one of a uint64, 0 to 63, as int64; 64 for no ones: lowest_one(word)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.uint64), build
