# SPDX-License-Identifier: GPL-3.0-or-later
"""Prefetch of an array's items into the processor's caches, for kernels that know early what they will read late."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_READ, _SOON_AGAIN, _DATA = 0, 3, 1  # arguments of llvm.prefetch


@intrinsic
def prefetch(_typing: Any, array: Any, index: Any) -> Any:
    """Begin to fetch the cache line of an item of an array (n,), and go on without waiting: prefetch(array, index).

    An index beyond the array is harmless.
    """

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.args[0]
        made = context.make_array(kind)(context, builder, arguments[0])
        item = cgutils.get_item_pointer(context, builder, kind, made, [arguments[1]])
        line = builder.bitcast(item, ir.IntType(8).as_pointer())
        word = ir.IntType(32)
        shape = ir.FunctionType(ir.VoidType(), [line.type, word, word, word])
        function = builder.module.declare_intrinsic("llvm.prefetch", [line.type], shape)
        builder.call(function, [line, word(_READ), word(_SOON_AGAIN), word(_DATA)])
        return context.get_dummy_value()

    flat = isinstance(array, types.Array) and array.ndim == 1
    return (types.none(array, types.int64), build) if flat and isinstance(index, types.Integer) else None
