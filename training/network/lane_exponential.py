# SPDX-License-Identifier: GPL-3.0-or-later
"""Powers of e of vectors in kernels, by the formula of `exponential` in `compiled_layers.py`, which is the reference.

The compiler makes vectors of plain loops with that one, but of shorter registers, and without products and sums in one.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.extending import intrinsic

_LOG2_E, _LN2_HIGH, _LN2_LOW = 1.4426950408889634, 0.693359375, -2.12194440e-4
_TERMS = 1.9875691500e-4, 1.3981999507e-3, 8.3334519073e-3, 4.1665795894e-2, 1.6666665459e-1, 5.0000001201e-1
_LEAST = -80.0  # powers below count as this one


@intrinsic
def falling_exponential(_typing: Any, power: Any) -> Any:
    """Vector of e^power, which float32 are taken as if they were in [-80, 0]: falling_exponential(power)."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = power.ir
        integers = ir.VectorType(ir.IntType(32), kind.count)

        def number(value: float) -> Any:
            return ir.Constant(kind, [ir.Constant(kind.element, value)] * kind.count)

        def integer(value: int) -> Any:
            return ir.Constant(integers, [value] * kind.count)

        def plus(left: Any, right: Any) -> Any:
            return builder.fadd(left, right, flags=("contract",))

        def times(left: Any, right: Any) -> Any:
            return builder.fmul(left, right, flags=("contract",))

        (value,) = arguments
        for sign, bound in (("<", number(_LEAST)), (">", number(0.0))):
            value = builder.select(builder.fcmp_ordered(sign, value, bound), bound, value)
        whole = _floor(builder, plus(times(value, number(_LOG2_E)), number(0.5)))
        rest = plus(plus(value, times(whole, number(-_LN2_HIGH))), times(whole, number(-_LN2_LOW)))
        terms = number(_TERMS[0])
        for term in _TERMS[1:]:
            terms = plus(times(terms, rest), number(term))
        terms = plus(plus(times(times(terms, rest), rest), rest), number(1.0))
        bits = builder.shl(builder.add(builder.fptosi(whole, integers), integer(127)), integer(23))
        return builder.fmul(terms, builder.bitcast(bits, kind))

    return power(power), build


def _floor(builder: Any, vector: Any) -> Any:
    name = f"llvm.floor.v{vector.type.count}f32"
    known = builder.module.globals.get(name)
    function = known or ir.Function(builder.module, ir.FunctionType(vector.type, [vector.type]), name)
    return builder.call(function, [vector])
