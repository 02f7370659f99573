# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a job from an operator's properties, else from the scene."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.frames import frame_range
from ..importance.painted import Importance
from ..scene_access.unread_file import check_opened
from ..schema.setting import Kind, Setting, names_of
from ..schema.values import AUTO, SELECTED, VISIBLE
from ..settings.cycles_settings import CyclesSettings
from ..settings.job_settings import SETTING_PATHS, TABLE, JobSettings
from .preferences import Preferences, preferences


def setting(context: bpy.types.Context, operator: bpy.types.Operator, name: str) -> Any:
    """Value of a setting: the operator's property if its caller set it, else the scene's."""
    return getattr(operator if is_given(operator, name) else context.scene.patchnet, name)


def is_given(operator: bpy.types.Operator, name: str) -> bool:
    """Return whether the operator has this property and its caller set it."""
    values = operator.properties
    return name in values.bl_rna.properties and values.is_property_set(name)


def wanted_frames(context: bpy.types.Context, operator: bpy.types.Operator) -> range:
    """Frames of an operator with `FrameProperties`; the scene's where its caller did not set them."""
    names = ("frame_start", "frame_end", "frame_step")
    return frame_range(*(int(getattr(operator if is_given(operator, name) else context.scene, name)) for name in names))


def absolute_path(text: str) -> Path | None:
    """Absolute path of a text that may begin with // for the folder of the .blend file; None for an empty one.

    Raises SettingError, or SceneError, if there is no such folder.
    """
    if not text:
        return None
    if text.startswith("//") and not bpy.data.filepath:
        check_opened()
        raise SettingError(f"Path '{text}' is relative to the .blend file: save the file first")
    return Path(bpy.path.abspath(text)).absolute()


def job_settings(context: bpy.types.Context, operator: bpy.types.Operator) -> JobSettings:
    """Settings of a job: the operator's properties where they are set, else the scene's.

    Raises SettingError for values that contradict each other or lie outside their range.
    """

    def value(name: str) -> Any:
        return setting(context, operator, name)

    scope = VISIBLE if bpy.app.background else SELECTED
    return _job_settings(value, _resolution(operator, value("resolution")), scope, preferences(context).colormap)


def scene_settings(scene: bpy.types.Scene) -> JobSettings:
    """Settings of a job from the scene alone, for renders: automatic scope means all visible objects.

    Raises SettingError.
    """
    values = scene.patchnet
    return _job_settings(lambda name: getattr(values, name), values.resolution, VISIBLE, Preferences().colormap)


def cycles_settings(context: bpy.types.Context, operator: bpy.types.Operator) -> CyclesSettings:
    """Settings of a refinement by Cycles, from the operator where they are set, else from the scene."""
    names = names_of(CyclesSettings)
    return CyclesSettings(**{field: setting(context, operator, name) for name, field in names.items()})


def _job_settings(value: Callable[[str], Any], resolution: str, automatic_scope: str, colormap: str) -> JobSettings:
    values = SimpleNamespace(**{name: value(name) for name in TABLE} | {"resolution": resolution})
    given = {}
    for row in (row for row in TABLE.values() if row.name in SETTING_PATHS):
        plain = _plain(row, getattr(values, row.name))
        row.check_value(plain)
        if row.counts(values):
            given[row.name] = plain
    given |= {
        "scope": automatic_scope if values.scope == AUTO else values.scope,
        "importance": Importance.chosen(values.importance, values.importance_image, values.importance_group),
        "colormap": colormap,
    }
    return JobSettings.of(**given)


def _plain(row: Setting, value: Any) -> Any:
    if isinstance(value, float):  # Blender's single precision; as commands have it: 0.01, not 0.009999999776
        value = float(str(np.float32(value)))
    if row.kind is Kind.AUTOMATIC:
        return value or None
    if row.kind is Kind.PAIR:
        return tuple(value)
    if row.kind is Kind.TEXT:
        return tuple(part.strip() for part in value.split(",") if part.strip())
    return absolute_path(value) if row.kind in (Kind.FILE, Kind.FOLDER) else value


def _resolution(operator: bpy.types.Operator, resolution: str) -> str:
    """Resolution of a job: a depth or voxel size given to an operator counts, without naming the resolution too."""
    given = [name for name in ("resolution", "depth", "voxel_size") if is_given(operator, name)]
    if "resolution" in given or not given:
        return resolution
    if len(given) == 2:
        raise SettingError("Depth and voxel size are both given: choose one of them")
    return given[0].upper()
