# SPDX-License-Identifier: GPL-3.0-or-later
"""Search over the scene's cameras, as Blender's fields that pick an object have it; several go with commas between."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, IntVectorProperty, StringProperty

from ...patchnet_addon.runtime.bounds import SHARE, Bounds
from ..scene.cameras import ALL, AUTO, scene_cameras
from ..schema.setting import Kind, Setting
from ..schema.table import CAMERAS, rows


def camera_candidates(_values: object, context: bpy.types.Context, text: str) -> list[tuple[str, str]]:
    """Candidates (value, what it is) for a text that is being typed: each camera, all of them, or views of the scene.

    After a comma, each camera that the text does not name yet is added to those that it names.
    """
    names = sorted(scene_cameras(context.scene))
    *before, _ = text.split(",")
    named = [name for name in map(str.strip, before) if name]
    if named:
        return [(", ".join([*named, name]), "One more camera") for name in names if name not in named]
    active = context.scene.camera
    cameras = [(name, "Active camera" if active is not None and active.name == name else "Camera") for name in names]
    several = [(ALL, "Every camera of the scene")] if len(names) > 1 else []
    return [*cameras, *several, (AUTO, "Three views of the scene, inside where it is a room")]


OF_ONE_CALL = {"SKIP_SAVE"}  # an operator forgets the value, so that the scene's counts for its next call


def number(name: str, description: str, default: float, bounds: Bounds, **others: Any) -> Any:
    """Property for a number of the table."""
    kind = IntProperty if bounds.whole else FloatProperty
    low, high = (int(bounds.low), int(bounds.high)) if bounds.whole else _inside(bounds)
    return kind(name=name, description=description, default=default, min=low, max=high, **others)


def _inside(bounds: Bounds) -> tuple[float, float]:
    """Lowest and highest number of single precision, as Blender keeps them, that is within the bounds."""
    low, high = np.float32(bounds.low), np.float32(bounds.high)
    low = low if low >= bounds.low else np.nextafter(low, np.float32(np.inf))
    high = high if high <= bounds.high else np.nextafter(high, np.float32(-np.inf))
    return float(low), float(high)


def share(
    name: str, description: str, default: float, bounds: Bounds = SHARE, update: Callable[..., None] | None = None
) -> Any:
    """Property for a part of a whole."""
    return number(name, description, default, bounds, subtype="FACTOR", update=update)


def property_of(row: Setting) -> Any:
    """Make the Blender property of a setting."""
    words, more = {"name": row.label, "description": row.description}, dict(row.widget)
    if row.kind is Kind.SWITCH:
        return BoolProperty(**words, default=row.default, **more)
    if row.kind is Kind.CHOICE:
        return EnumProperty(**words, items=list(row.choices), default=row.default, **more)
    if row.kind is Kind.TEXT:
        if row.stage == CAMERAS:
            more |= {"search": camera_candidates, "search_options": {"SUGGESTION"}}
        return StringProperty(**words, **more)
    if row.kind in (Kind.FILE, Kind.FOLDER):
        subtype = "FILE_PATH" if row.kind is Kind.FILE else "DIR_PATH"
        return StringProperty(**words, subtype=subtype, options={"PATH_SUPPORTS_BLEND_RELATIVE"})
    assert row.bounds is not None
    if row.kind is Kind.PAIR:
        low, high = int(row.bounds.low), int(row.bounds.high)
        return IntVectorProperty(**words, size=2, default=row.default, min=low, max=high, **more)
    if row.kind is Kind.AUTOMATIC:
        return FloatProperty(**words, default=row.default or 0.0, min=0.0, max=_inside(row.bounds)[1], **more)
    make = share if row.kind is Kind.SHARE else number
    return make(row.label, row.description, row.default, row.bounds, **more)


def properties_of(*stages: str) -> dict[str, Any]:
    """Blender properties of all settings of some stages, as the annotations of a class."""
    return {row.name: property_of(row) for row in rows(*stages)}
