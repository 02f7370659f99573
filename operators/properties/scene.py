# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the panel that read and write other settings, and keep nothing themselves.

Sides of pictures, as in Blender's Format panel; checkboxes of numbers that are found where they are 0, as Cycles has
them; and the few strategies of a short list.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, PointerProperty

from ...patchnet_addon.runtime.bounds import SIZE_PX
from ...patchnet_addon.sampling.registry import FOR_USERS, STRATEGIES
from ..schema.setting import Kind
from ..schema.table import TABLE
from .shapes import number
from .stages import AnimationProperties, CyclesRefineProperties, DisplayProperties, JobProperties, RenderProperties

_SIDES = {"size_x": 0, "size_y": 1}
_OTHER = "other"
_FIRST_LEVEL = 6  # few enough voxels of any scene to show as cubes


def _side(name: str, index: int) -> Any:
    """Property for a side of the setting `size`."""

    def read(values: bpy.types.PropertyGroup) -> int:
        return int(values.size[index])

    def write(values: bpy.types.PropertyGroup, side: int) -> None:
        values.size[index] = side

    text = "Pixels of the pictures; 0 follows the other side by the render aspect, twice 0 is the render resolution"
    return number(name, text, TABLE["size"].default[index], SIZE_PX, subtype="PIXEL", get=read, set=write)


def _checkbox(name: str, label: str, first: float) -> Any:
    """Property that is on where the number `name` is not 0; turned on, it sets that to `first`."""

    def read(values: bpy.types.PropertyGroup) -> bool:
        return bool(getattr(values, name))

    def write(values: bpy.types.PropertyGroup, on: bool) -> None:
        if on != read(values):
            setattr(values, name, first if on else 0)

    return BoolProperty(name=label, description="Set the number by hand, instead of automatically", get=read, set=write)


def _short_list() -> Any:
    """Property for the strategy among those for users."""
    titles = [(name, STRATEGIES[name].title, STRATEGIES[name].description) for name in FOR_USERS]

    def read(values: bpy.types.PropertyGroup) -> int:
        return FOR_USERS.index(values.strategy) if values.strategy in FOR_USERS else len(FOR_USERS)

    def write(values: bpy.types.PropertyGroup, index: int) -> None:
        if index < len(FOR_USERS):
            values.strategy = FOR_USERS[index]

    items = [*titles, (_OTHER, "Other", "A strategy chosen in Compare, which lists all of them")]
    order = TABLE["strategy"].description
    return EnumProperty(name="Strategy", description=order, items=items, get=read, set=write)


def _checkboxes() -> dict[str, Any]:
    numbers = {row.name: (row.label, row.first) for row in TABLE.values() if row.kind is Kind.AUTOMATIC}
    label, first = TABLE["size"].label, TABLE["size"].first
    numbers |= {name: (f"{label} {name[-1].upper()}", first[index]) for name, index in _SIDES.items()}
    numbers["level"] = ("Level", _FIRST_LEVEL)
    return {f"use_{name}": _checkbox(name, *of) for name, of in numbers.items()}


class DerivedProperties:
    """Sides of pictures, checkboxes, and the short list of strategies."""

    __annotations__ = {name: _side(f"Picture Size {name[-1].upper()}", index) for name, index in _SIDES.items()}
    __annotations__ |= _checkboxes() | {"short_strategy": _short_list()}


class PatchNetSettings(
    JobProperties,
    DerivedProperties,
    AnimationProperties,
    DisplayProperties,
    CyclesRefineProperties,
    RenderProperties,
    bpy.types.PropertyGroup,
):
    """Settings that a scene remembers; operators use them for whatever is not given to themselves."""


def register() -> None:
    """Give scenes their settings."""
    bpy.utils.register_class(PatchNetSettings)
    bpy.types.Scene.patchnet = PointerProperty(type=PatchNetSettings)


def unregister() -> None:
    """Take the settings away."""
    del bpy.types.Scene.patchnet
    bpy.utils.unregister_class(PatchNetSettings)
