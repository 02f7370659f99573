# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a job, read from an operator and the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import bpy

from ....patchnet_addon.runtime.bounds import MEMORY_GIB
from ....patchnet_addon.runtime.errors import SettingError
from ...importance import Importance
from ...scene.placements import SELECTED, VISIBLE
from ...settings.job_settings import JobSettings
from ..preferences import Preferences, preferences
from .given import absolute_path, is_given, setting


def job_settings(context: bpy.types.Context, operator: bpy.types.Operator) -> JobSettings:
    """Settings of a job: the operator's properties where they are set, else the scene's.

    Raises SettingError for values that contradict each other or lie outside their range.
    """

    def value(name: str) -> Any:
        return setting(context, operator, name)

    scope = VISIBLE if bpy.app.background else SELECTED
    mine = preferences(context)
    settings = _job_settings(value, _resolution(operator, value("resolution")), scope, mine.colormap)
    return replace(settings, torch_python=absolute_path(mine.torch_python))


def scene_settings(scene: bpy.types.Scene) -> JobSettings:
    """Settings of a job by the scene alone, as its renders take them: automatic scope is all that is visible.

    Raises SettingError.
    """
    values = scene.patchnet
    return _job_settings(lambda name: getattr(values, name), values.resolution, VISIBLE, Preferences().colormap)


def _job_settings(value: Callable[[str], Any], resolution: str, automatic_scope: str, colormap: str) -> JobSettings:
    scope = value("scope")
    return JobSettings(
        scope=automatic_scope if scope == "AUTO" else scope,
        depth=value("depth") if resolution == "DEPTH" else None,
        voxel_world=value("voxel_size") if resolution == "VOXEL_SIZE" else None,
        fit=resolution == "FIT",
        track=resolution == "FIT" and value("track"),
        memory_bytes=_bytes(value("memory")),
        light=value("light"),
        samples=value("samples"),
        exposure=value("exposure") or None,
        both_sides=value("both_sides"),
        color=value("color"),
        texel_voxels=value("texel_voxels"),
        cameras=tuple(name.strip() for name in value("cameras").split(",") if name.strip()),
        size=(value("size")[0], value("size")[1]),
        budget=value("budget"),
        strategy=value("strategy"),
        heatmap_maximum=value("heatmap_maximum") or None,
        colormap=colormap,
        weights=absolute_path(value("weights")),
        out=absolute_path(value("out")),
        importance=Importance.chosen(value("importance"), value("importance_image"), value("importance_group")),
        device=value("device"),
        encoder_device=value("encoder_device"),
    )


def _bytes(gib: float) -> int | None:
    """Bytes of a memory limit; None for 0; raises SettingError, since Blender lets a script set NaN."""
    if gib:
        MEMORY_GIB.check(gib)
    return round(gib * 2**30) or None


def _resolution(operator: bpy.types.Operator, resolution: str) -> str:
    """Resolution of a job: a depth or voxel size given to an operator counts, without naming the resolution too."""
    given = [name for name in ("resolution", "depth", "voxel_size") if is_given(operator, name)]
    if "resolution" in given or not given:
        return resolution
    if len(given) == 2:
        raise SettingError("Depth and voxel size are both given: choose one of them")
    return given[0].upper()
