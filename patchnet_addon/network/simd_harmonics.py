# SPDX-License-Identifier: GPL-3.0-or-later
"""Spherical harmonics of vectors in kernels, by evaluating the formulas of `harmonics.py` on instructions."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from .harmonics import harmonic_terms


class _Term:
    """Term of a formula: its arithmetic appends instructions to the function in compilation."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _of(self, other: Any) -> Any:
        if isinstance(other, _Term):
            return other.value
        kind = self.value.type
        return ir.Constant(kind, [float(other)] * kind.count)

    def __add__(self, other: Any) -> _Term:
        return _Term(self.builder, self.builder.fadd(self.value, self._of(other), flags=("contract",)))

    def __sub__(self, other: Any) -> _Term:
        return _Term(self.builder, self.builder.fsub(self.value, self._of(other), flags=("contract",)))

    def __mul__(self, other: Any) -> _Term:
        return _Term(self.builder, self.builder.fmul(self.value, self._of(other), flags=("contract",)))

    __radd__, __rmul__ = __add__, __mul__


@intrinsic
def store_harmonics(_typing: Any, array: Any, _index: Any, _stride: Any, x: Any, y: Any, z: Any) -> Any:
    """Store the 25 harmonics of vectors of directions: store_harmonics(array, index, stride, x, y, z).

    The first one is at the index, each further one `stride` elements later.
    """

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        index, stride = arguments[1:3]
        x, y, z = (_Term(builder, axis) for axis in arguments[3:])
        for term in harmonic_terms(x, y, z):
            pointer = builder.bitcast(builder.gep(data, [index]), term.value.type.as_pointer())
            builder.store(term.value, pointer).align = 4
            index = builder.add(index, stride)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, x, y, z), build
