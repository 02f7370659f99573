# SPDX-License-Identifier: GPL-3.0-or-later
"""Unsteady corner values: UV coordinates and colours whose last bits differ each time Blender evaluates an object.

The Bevel modifier takes means of what meets at a vertex in an order that follows addresses in memory. Hashes of such an
object hold what the values are made from in their place, so that the same scene has the same key in each process, and a
bake that was stopped goes on there.
"""

from __future__ import annotations

import bpy

from .digest import Digest

_UNSTEADY = frozenset({"BEVEL"})


def origin_of_corners(item: bpy.types.Object) -> str:
    """32 hex digits over the user's own mesh and the modifiers of an evaluated object; "" where values are steady."""
    if not any(modifier.type in _UNSTEADY for modifier in item.modifiers):
        return ""
    digest = Digest()
    digest.block(item.original.data)
    for modifier in item.modifiers:
        digest.modifier(modifier)
    return digest.hexdigest()
