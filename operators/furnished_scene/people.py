# SPDX-License-Identifier: GPL-3.0-or-later
"""Stools for people who sit: as high as they do, within the box that is kept for them."""

from __future__ import annotations

import bpy
import numpy as np

from ..demo_scene.geometry import Shape, box, join, place
from .mesh_repair import vertices_of

_BACK_SHARE, _LOWEST = 0.3, 0.25  # of the depth of a sitting person, from the back; metres


def build_stool(
    collection: bpy.types.Collection, person: bpy.types.Mesh, material: bpy.types.Material, name: str
) -> bpy.types.Object | None:
    """Build a stool under a person of `models.py` who sits with the back towards +y; None if nothing is above it."""
    points = vertices_of(person)
    low, high = points.min(axis=0), points.max(axis=0)
    back = points[points[:, 1] > high[1] - _BACK_SHARE * (high[1] - low[1])]
    height = float(back[:, 2].min())
    if height < _LOWEST:
        return None
    return place(collection, name, _stool(back, height), material)


def _stool(back: np.ndarray, height: float) -> Shape:
    (x0, y0, _), (x1, y1, _) = back.min(axis=0), back.max(axis=0)
    legs = [box((x, y, 0.0), (x + 0.03, y + 0.03, height - 0.04)) for x in (x0, x1 - 0.03) for y in (y0, y1 - 0.03)]
    return join([box((x0, y0, height - 0.04), (x1, y1, height)), *legs])
