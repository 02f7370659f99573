# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides and faces for kernels, see `sides.py`."""

from __future__ import annotations

from ..runtime.kernels import device
from .sides import FRONT, LIT_FRONT


@device
def lit_sides(lit, triangle):
    """Lit sides of a triangle; of all if there are none, the front."""
    return lit[triangle] if len(lit) else LIT_FRONT


@device
def is_lit(lit, side):
    """Whether a side is among the lit ones."""
    return lit == 0 or (lit > 0) == (side == FRONT)


@device
def face_towards(axis, along):
    """Face across an axis that a direction points to whose component there is `along`; the upper one if that is 0."""
    return 2 * axis + (1 if along < 0.0 else 0)
