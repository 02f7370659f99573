# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the stages of a job, for scenes and operators; declared in the table of settings.

Those of the panel that read and write other settings keep nothing themselves: sides of pictures, as in Blender's Format
panel; checkboxes of numbers that are found where they are 0, as Cycles has them; the few strategies of a short list.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from ...patchnet_addon.runtime.bounds import FRAME, FRAME_STEP, LEVEL, SHARE, SHOWN_VOXELS, SIZE_PX, Bounds
from ...patchnet_addon.sampling.registry import FOR_USERS, STRATEGIES
from ..scene.cameras import ALL, AUTO, scene_cameras
from ..schema.setting import Kind, Setting
from ..schema.values import CAMERAS, JOB, REFINEMENT, RENDERS
from ..settings.job_settings import TABLE, rows


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
        return EnumProperty(**words, items=_numbered(row), default=_default(row), **more)
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
    return make(row.label, row.description, _default(row), row.bounds, **more)


def _default(row: Setting) -> Any:
    return row.default if row.shown is None else row.shown


def _numbered(row: Setting) -> list[tuple[str, str, str, int]]:
    """Choices with their numbers, by which files hold them: none has that of a choice that is gone."""
    numbers = (number for number in count() if number not in row.gone)
    return [(*choice, number) for choice, number in zip(row.choices, numbers, strict=False)]


def properties_of(*stages: str) -> dict[str, Any]:
    """Blender properties of all settings of some stages, as the annotations of a class."""
    return {row.name: property_of(row) for row in rows(*stages)}


class AnimationProperties:
    """Animation: how its frames are baked."""

    skip_existing: BoolProperty(
        name="Skip Finished",
        description="Keep frames whose files are complete and up to date, instead of baking them again",
        default=True,
    )
    same_grid: BoolProperty(
        name="Same Voxel Grid",
        description="Keep voxels at the same places at all frames, so that pictures do not flicker; reads the scene at "
        "all frames first",
        default=False,
    )


def _frame(name: str, description: str, default: int, bounds: Bounds = FRAME) -> Any:
    """Property for a frame, or a number of frames; the scene has them already, as its frame range."""
    return number(name, f"{description}; the scene's if it is not given", default, bounds, options=OF_ONE_CALL)


class FrameProperties:
    """Frame range; that of the scene where they are not given."""

    frame_start: _frame("Frame Start", "First frame", 1)
    frame_end: _frame("Frame End", "Last frame", 250)
    frame_step: _frame("Frame Step", "Frames from one to the next", 1, FRAME_STEP)


class LevelProperties:
    """Level that is shown or exported."""

    level: number(
        "Level (0 Finest)",  # read in Adjust Last Operation and the file browser; the panel has a checkbox
        "Level of the voxels, each half as large as on the one before; 0 takes the finest",
        0,
        LEVEL,
        options=OF_ONE_CALL,
    )


class DisplayProperties(LevelProperties):
    """Voxels in the scene. Operators forget these values, so that those of the panel count for each call."""

    limit: number(
        "Voxel Limit",
        "Most voxels to show; a higher limit shows finer levels and draws slower",
        200_000,
        SHOWN_VOXELS,
        soft_max=5_000_000,
        options=OF_ONE_CALL,
    )


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


def _own_track() -> Any:
    """Property that is on where a track has frames of its own; turned on, it sets those of the scene."""

    def read(values: bpy.types.PropertyGroup) -> bool:
        return any(values.track_frames)

    def write(values: bpy.types.PropertyGroup, on: bool) -> None:
        if on != read(values):
            scene = values.id_data
            values.track_frames = (scene.frame_start, scene.frame_end) if on else (0, 0)

    text = "Keep the frames that voxels are fitted to when the scene's frames change, instead of following them"
    return BoolProperty(name=TABLE["track_frames"].label, description=text, get=read, set=write)


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
    __annotations__ |= _checkboxes() | {"use_track_frames": _own_track(), "short_strategy": _short_list()}


class PatchNetSettings(DerivedProperties, AnimationProperties, DisplayProperties, bpy.types.PropertyGroup):
    """Settings that a scene remembers; operators use them for whatever is not given to themselves."""

    __annotations__ = properties_of(*JOB, REFINEMENT, RENDERS)


@persistent
def _forget_gone(*_: object) -> None:
    """Give settings of an older file their default whose choice is gone."""
    for values in (scene.patchnet for scene in bpy.data.scenes if scene.library is None):
        for row in TABLE.values():
            if row.gone and not getattr(values, row.name):
                values.property_unset(row.name)


HANDLERS = (("load_post", _forget_gone),)


def register() -> None:
    """Give scenes their settings."""
    bpy.types.Scene.patchnet = PointerProperty(type=PatchNetSettings)


def unregister() -> None:
    """Take the settings away."""
    del bpy.types.Scene.patchnet
