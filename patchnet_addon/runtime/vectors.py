# SPDX-License-Identifier: GPL-3.0-or-later
"""SIMD vectors in kernels: values with a number for each of several lanes, and their arithmetic.

The compiler vectorizes simple loops, but neither traverses trees so, nor keeps the sums of a matrix product in
registers. There a kernel uses explicit vectors: operators work lane by lane, and comparisons return a bit mask of
lanes, lane 0 lowest. Processors with shorter registers use several for one vector. Indices are flat, into C-ordered
arrays, and unchecked. Bit operations, one instruction each, take int64, uint64, or the int32 bits of a float.
"""

from __future__ import annotations

import operator
from collections.abc import Callable

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from .kernels import device

LANES = 16
OCTANTS = 8

HALF_SCALE = 2.0**112
"""Scale of `load_halves`: the ratio of the smallest half float to a float32 of the same bits."""

_MASK = types.int64
_WORDS = types.int64, types.uint64


@intrinsic
def count_ones(_typing, word):
    """Number of set bits of a word, as int64: count_ones(word)."""

    def build(_context, builder, _signature, arguments):
        return builder.ctpop(arguments[0])

    return (types.int64(word), build) if word in _WORDS else None


@intrinsic
def lowest_one(_typing, word):
    """Index of the lowest set bit of a word, as int64; 64 for a zero word: lowest_one(word)."""

    def build(_context, builder, _signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return (types.int64(word), build) if word in _WORDS else None


@intrinsic
def float_of_bits(_typing, word):
    """float32 with the bits of an int32: float_of_bits(word)."""

    def build(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], ir.FloatType())

    return (types.float32(word), build) if word == types.int32 else None


class VectorType(types.Type):
    """numba type of a vector of floats."""

    def __init__(self, element: types.Float, lanes: int) -> None:
        self.element, self.lanes = element, lanes
        super().__init__(name=f"Vector({element}, {lanes})")

    @property
    def ir(self) -> ir.VectorType:
        """LLVM type."""
        return ir.VectorType(ir.DoubleType() if self.element == types.float64 else ir.FloatType(), self.lanes)


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.ir)


_FLOATS = VectorType(types.float32, LANES)


def _vectors(*found: object) -> bool:
    return all(isinstance(one, VectorType) for one in found) and len(set(found)) == 1


class _Arithmetic(AbstractTemplate):
    def generic(self, args, kws):
        if len(args) == 2 and not kws and _vectors(*args):
            return signature(args[0], *args)
        return None


def _register(function: Callable[..., object], name: str) -> None:
    infer_global(function)(type(f"_Vector{name}", (_Arithmetic,), {}))

    def build(_context, builder, _signature, arguments):
        return getattr(builder, name)(*arguments)

    lower_builtin(function, VectorType, VectorType)(build)


_register(operator.add, "fadd")
_register(operator.sub, "fsub")
_register(operator.mul, "fmul")
_register(operator.truediv, "fdiv")


def build_splat(builder, kind, value):
    """Build a vector with the same number in every lane."""
    nothing = ir.Constant(kind.ir, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.IntType(32)(0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), kind.lanes), None))


@intrinsic
def splat(_typing, number):
    """Vector with the same number in every lane: splat(number)."""
    kind = VectorType(number, LANES)

    def build(_context, builder, _signature, arguments):
        return build_splat(builder, kind, arguments[0])

    return kind(number), build


@intrinsic
def load(_typing, array, _index):
    """Load a vector from an index on: load(array, index)."""
    kind = VectorType(array.dtype, LANES)

    def build(context, builder, signature, arguments):
        address = array_address(context, builder, signature, *arguments)
        vector = builder.load(builder.bitcast(address, kind.ir.as_pointer()))
        vector.align = array.dtype.bitwidth // 8
        return vector

    return kind(array, types.intp), build


@intrinsic
def spread(_typing, array, _index):
    """Vector of one element in every lane, faster than its `splat`: spread(array, index)."""
    kind = VectorType(array.dtype, LANES)

    def build(context, builder, signature, arguments):
        element = builder.load(array_address(context, builder, signature, *arguments))
        return build_splat(builder, kind, element)

    return kind(array, types.intp), build


@intrinsic
def load_halves(_typing, array, _first, _second):
    """Vector of 16 half floats / `HALF_SCALE`: load_halves(array, first, second).

    Eight begin at the first index, eight at the second, in an array of int16. The bits of a half float, shifted to
    those of a float32, give a value too small by this factor; infinities become numbers. So shifts suffice, and
    processors without half floats have the same bits.
    """

    def build(context, builder, signature, arguments):
        eight = ir.VectorType(ir.IntType(16), 8)
        parts = []
        for index in arguments[1:]:
            address = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            parts.append(builder.load(builder.bitcast(builder.gep(address, [index]), eight.as_pointer())))
            parts[-1].align = 2
        integers = ir.VectorType(ir.IntType(32), 16)
        both = builder.shuffle_vector(*parts, ir.Constant(integers, list(range(16))))
        bits = builder.shl(builder.sext(both, integers), ir.Constant(integers, [13] * 16))
        bits = builder.and_(bits, ir.Constant(integers, [0x8FFFFFFF] * 16))  # without the sign's copies
        return builder.bitcast(bits, _FLOATS.ir)

    return _FLOATS(array, types.intp, types.intp), build


@intrinsic
def store(_typing, array, _index, vector):
    """Store a vector from an index on: store(array, index, vector)."""

    def build(context, builder, signature, arguments):
        address = array_address(context, builder, signature, *arguments[:2])
        pointer = builder.bitcast(address, vector.ir.as_pointer())
        builder.store(arguments[2], pointer).align = array.dtype.bitwidth // 8
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), build


@intrinsic
def add_product(_typing, total, left, right):
    """Vector total + left * right, rounded once where the processor can: add_product(total, left, right)."""

    def build(_context, builder, _signature, arguments):
        total, left, right = arguments
        return builder.fadd(total, builder.fmul(left, right, flags=("contract",)), flags=("contract",))

    return total(total, left, right), build


@intrinsic
def words_set(_typing, array, _index):
    """Bit mask of the nonzero words of eight uint32 from an index on: words_set(array, index)."""

    def build(context, builder, signature, arguments):
        kind = ir.VectorType(ir.IntType(32), OCTANTS)
        address = array_address(context, builder, signature, *arguments)
        words = builder.load(builder.bitcast(address, kind.as_pointer()))
        words.align = 4
        there = builder.icmp_unsigned("!=", words, ir.Constant(kind, [0] * OCTANTS))
        return builder.zext(builder.bitcast(there, ir.IntType(OCTANTS)), ir.IntType(64))

    return (_MASK(array, types.intp), build) if array.dtype == types.uint32 else None


def _choosing(sign: str) -> Callable[..., object]:
    def typing(_typing, left, right):
        def build(_context, builder, _signature, arguments):
            first, second = arguments
            return builder.select(builder.fcmp_ordered(sign, first, second), first, second)

        return (left(left, right), build) if _vectors(left, right) else None

    return typing


smaller = intrinsic(_choosing("<"))  # lane-wise minimum: smaller(left, right)
larger = intrinsic(_choosing(">"))  # lane-wise maximum: larger(left, right)


@intrinsic
def less(_typing, left, right):
    """Bit mask of lanes with left < right: less(left, right)."""

    def build(_context, builder, _signature, arguments):
        bits = builder.bitcast(builder.fcmp_ordered("<", *arguments), ir.IntType(left.lanes))
        return builder.zext(bits, ir.IntType(64))

    return (_MASK(left, right), build) if _vectors(left, right) else None


@intrinsic
def select(_typing, mask, left, right):
    """Vector of `left` in the lanes of a mask, of `right` in the others: select(mask, left, right)."""

    def build(_context, builder, _signature, arguments):
        bits = builder.trunc(arguments[0], ir.IntType(left.lanes))
        chosen = builder.bitcast(bits, ir.VectorType(ir.IntType(1), left.lanes))
        return builder.select(chosen, arguments[1], arguments[2])

    return (left(_MASK, left, right), build) if isinstance(mask, types.Integer) and _vectors(left, right) else None


@device
def put(array, index, lanes, values):
    """Store a vector from an index on, in some lanes: put(array, index, mask, vector)."""
    store(array, index, select(lanes, values, load(array, index)))


@intrinsic
def square_root(_typing, vector):
    """Vector of square roots: square_root(vector)."""

    def build(_context, builder, _signature, arguments):
        return builder.call(_intrinsic(builder, "sqrt", vector, vector.ir), arguments)

    return vector(vector), build


@intrinsic
def largest(_typing, vector):
    """Maximum of a vector's lanes: largest(vector)."""

    def build(_context, builder, _signature, arguments):
        function = _intrinsic(builder, "vector.reduce.fmax", vector, vector.ir.element)
        return builder.call(function, arguments, fastmath=("nnan",))

    return vector.element(vector), build


def _intrinsic(builder, name, vector, result):
    """Declare an LLVM intrinsic function of a vector."""
    name = f"llvm.{name}.v{vector.lanes}f{vector.element.bitwidth}"
    known = builder.module.globals.get(name)
    return known or ir.Function(builder.module, ir.FunctionType(result, [vector.ir]), name)


def array_address(context, builder, signature, array, index):
    """Build the address of an array element; the array is the first argument of `signature`."""
    data = context.make_array(signature.args[0])(context, builder, array).data
    return builder.gep(data, [index])
