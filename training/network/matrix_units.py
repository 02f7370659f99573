# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix units of a processor (Intel's AMX) in kernels: products of blocks of 32 x 32 numbers of bfloat16.

A unit has eight tiles of 16 lines of 64 bytes. Four hold the sums of a block, float32, two each the factors: 32 lines
of 32 numbers, and 16 lines of 32 columns' pairs of numbers, one below the other (`pack_pairs` of tile_layout.py). So a
kernel clears or loads the sums, adds products of 32 numbers after 32, and stores them.

Lines that begin at a multiple of 64 bytes are read six times as fast as others: see `runtime/aligned_memory.py`.
Indices and steps count elements of flat, C-ordered arrays, and are not checked. Code that calls these functions only
compiles where `matrix_units_usable` says so; `use_units` comes first, `leave_units` last.
"""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from typing import Any

import numpy as np
from llvmlite import binding, ir
from numba.core import types
from numba.extending import intrinsic

from ...patchnet_addon.runtime.vectors import array_address

SIDE = 32  # of a block of sums, and numbers that a product takes at once
_LINES, _LINE_BYTES = 16, 64  # of a tile
_SUMS, _LEFT, _RIGHT = (0, 1, 2, 3), (4, 5), (6, 7)  # tiles
_ARCH_PRCTL, _ASK_FOR_STATE, _TILE_DATA = 158, 0x1023, 18  # Linux: its call, what to do, what with
_BYTE, _WORD = ir.IntType(8), ir.IntType(64)


def matrix_units_allowed() -> bool:
    """Whether oneDNN's variable ONEDNN_MAX_CPU_ISA, by which torch's products leave them out, lets them be used."""
    allowed = os.environ.get("ONEDNN_MAX_CPU_ISA", "ALL").upper()
    return allowed in ("", "ALL", "DEFAULT") or "AMX" in allowed


@cache
def matrix_units_usable() -> bool:
    """Whether kernels may use matrix units here: the processor has them, and Linux lends them to this process."""
    if not matrix_units_allowed() or not sys.platform.startswith("linux"):
        return False
    try:
        features = binding.get_host_cpu_features()
    except RuntimeError:  # LLVM knows nothing about this processor
        return False
    if not (features.get("amx-tile") and features.get("amx-bf16") and features.get("avx512f")):
        return False
    return bool(ctypes.CDLL(None).syscall(_ARCH_PRCTL, _ASK_FOR_STATE, _TILE_DATA) == 0)


def _tile_shapes() -> bytes:
    """Shapes of all tiles, as the processor is told them: palette 1, bytes of a line, lines."""
    shapes = np.zeros(64, np.uint8)
    shapes[0] = 1
    shapes[16:32].view(np.uint16)[:] = _LINE_BYTES
    shapes[48:56] = _LINES
    return shapes.tobytes()


def _call(builder: Any, name: str, *arguments: Any) -> None:
    """Build a call of one of the compiler's functions for matrix units, of whichever name."""
    kind = ir.FunctionType(ir.VoidType(), [argument.type for argument in arguments])
    known = builder.module.globals.get(f"llvm.x86.{name}")
    builder.call(known or ir.Function(builder.module, kind, f"llvm.x86.{name}"), arguments)


def _move_tiles(builder: Any, name: str, tiles: tuple[int, ...], addresses: list[Any], step: Any) -> None:
    for tile, address in zip(tiles, addresses, strict=True):
        _call(builder, name, _BYTE(tile), builder.bitcast(address, _BYTE.as_pointer()), step)


def _bytes(builder: Any, element: int, step: Any) -> Any:
    return builder.mul(step, _WORD(element))


@intrinsic
def use_units(_typing: Any) -> Any:
    """Tell the processor the shapes of its tiles: use_units()."""

    def build(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        shapes = context.insert_const_bytes(builder.module, _tile_shapes(), "patchnet.tile.shapes")
        _call(builder, "ldtilecfg", shapes)
        return context.get_dummy_value()

    return types.void(), build


@intrinsic
def leave_units(_typing: Any) -> Any:
    """Leave the tiles, as whoever uses them next expects: leave_units()."""

    def build(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        _call(builder, "tilerelease")
        return context.get_dummy_value()

    return types.void(), build


@intrinsic
def clear_sums(_typing: Any) -> Any:
    """Set all sums of the block to 0: clear_sums()."""

    def build(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        for tile in _SUMS:
            _call(builder, "tilezero", _BYTE(tile))
        return context.get_dummy_value()

    return types.void(), build


def _moving(name: str) -> Any:
    def typing(_typing: Any, array: Any, _index: Any, _step: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            array, index, step = arguments
            down = builder.mul(step, _WORD(_LINES))
            places = [builder.add(index, part) for part in (_WORD(0), _WORD(_LINES), down)]
            places.append(builder.add(places[2], _WORD(_LINES)))
            addresses = [array_address(context, builder, signature, array, place) for place in places]
            _move_tiles(builder, name, _SUMS, addresses, _bytes(builder, 4, step))
            return context.get_dummy_value()

        return types.void(array, types.intp, types.intp), build

    return typing


load_sums = intrinsic(_moving("tileloadd64"))  # sums of a block of float32 with `step` a line: (array, index, step)
store_sums = intrinsic(_moving("tilestored64"))  # the inverse: store_sums(array, index, step)


@intrinsic
def add_products(
    _typing: Any, left: Any, _top: Any, _bottom: Any, _step: Any, right: Any, _first: Any, _second: Any
) -> Any:
    """Add products of 32 numbers each: add_products(left, top, bottom, step, right, first, second).

    left: 16 lines of 32 numbers from `top` on and 16 from `bottom` on, `step` a line. right: two tiles of 16 columns'
    pairs, 512 numbers each, from `first` on and from `second` on.
    """

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        left, top, bottom, step, right, first, second = arguments

        def address(argument: int, array: Any, index: Any) -> Any:
            data = context.make_array(signature.args[argument])(context, builder, array).data
            return builder.gep(data, [index])

        lines = [address(0, left, top), address(0, left, bottom)]
        pairs = [address(4, right, first), address(4, right, second)]
        _move_tiles(builder, "tileloadd64", _LEFT, lines, _bytes(builder, 2, step))
        _move_tiles(builder, "tileloadd64", _RIGHT, pairs, _WORD(_LINE_BYTES))
        for tile in _SUMS:
            _call(builder, "tdpbf16ps", _BYTE(tile), _BYTE(_LEFT[tile // 2]), _BYTE(_RIGHT[tile % 2]))
        return context.get_dummy_value()

    index = types.intp
    return types.void(left, index, index, index, right, index, index), build


@intrinsic
def transpose_words(
    _typing: Any, source: Any, _from: Any, _source_step: Any, target: Any, _to: Any, _target_step: Any
) -> Any:
    """Write 16 lines of 16 words of 32 bits with rows for columns: (source, index, step, target, index, step)."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source, begin, source_step, target, to, target_step = arguments
        kind = ir.VectorType(ir.IntType(32), _LINES)

        def address(argument: int, array: Any, index: Any, step: Any, line: int) -> Any:
            data = context.make_array(signature.args[argument])(context, builder, array).data
            place = builder.add(index, builder.mul(step, _WORD(line)))
            return builder.bitcast(builder.gep(data, [place]), kind.as_pointer())

        lines = []
        for line in range(_LINES):
            lines.append(builder.load(address(0, source, begin, source_step, line)))
            lines[-1].align = 4
        for apart in (1, 2, 4, 8):  # numbers change places with those `apart` lines below and columns to the left
            upper = [c if not c & apart else _LINES + c - apart for c in range(_LINES)]
            lower = [c + apart if not c & apart else _LINES + c for c in range(_LINES)]
            masks = [ir.Constant(ir.VectorType(ir.IntType(32), _LINES), mask) for mask in (upper, lower)]
            for line in range(_LINES):
                if not line & apart:
                    both = lines[line], lines[line + apart]
                    lines[line], lines[line + apart] = (builder.shuffle_vector(*both, mask) for mask in masks)
        for line in range(_LINES):
            builder.store(lines[line], address(3, target, to, target_step, line)).align = 4
        return context.get_dummy_value()

    index = types.intp
    return types.void(source, index, index, target, index, index), build
