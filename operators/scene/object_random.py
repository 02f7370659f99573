# SPDX-License-Identifier: GPL-3.0-or-later
"""Random number that Cycles gives each object (node Object Info)."""

from __future__ import annotations

import bpy

_MASK = 0xFFFFFFFF


def object_random(instance: bpy.types.DepsgraphObjectInstance) -> float:
    """Random number in [0, 1]: of an instance by its id, of an object by its name."""
    if instance.is_instance:
        number = instance.random_id & _MASK
    else:
        number = _hash(_hash_string(instance.object.name), 0)
    return number / _MASK


def _hash_string(text: str) -> int:
    """Polynomial of the bytes at 37."""
    value = 0
    for byte in text.encode():
        value = (value * 37 + byte) & _MASK
    return value


def _hash(x: int, y: int) -> int:
    """Hash two words by Bob Jenkins' lookup3."""
    a = b = c = (0xDEADBEEF + (2 << 2) + 13) & _MASK
    a, b = (a + x) & _MASK, (b + y) & _MASK
    c = ((c ^ b) - _rotated(b, 14)) & _MASK
    a = ((a ^ c) - _rotated(c, 11)) & _MASK
    b = ((b ^ a) - _rotated(a, 25)) & _MASK
    c = ((c ^ b) - _rotated(b, 16)) & _MASK
    a = ((a ^ c) - _rotated(c, 4)) & _MASK
    b = ((b ^ a) - _rotated(a, 14)) & _MASK
    return ((c ^ b) - _rotated(b, 24)) & _MASK


def _rotated(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK
