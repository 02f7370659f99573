# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a job: five groups, which check their values, and access by flat names."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ...patchnet_addon.runtime.errors import SettingError
from ..schema.setting import Effect
from ..schema.table import CAMERAS, CYCLES, EXACT_SHAPE, IMPORTANCE, LIGHT, OCTREE, TABLE, VIEW, result_fields, rows
from .groups import (
    ComputeSettings,
    LightSettings,
    NetworkSettings,
    SurfaceSettings,
    ViewSettings,
    fields_by_flat_name,
)

if TYPE_CHECKING:
    from ...patchnet_addon.lod.depth import Contents

ESTIMATED = (OCTREE, LIGHT, CAMERAS)  # inputs of an estimate
_PARTS = {VIEW: (CAMERAS, VIEW, IMPORTANCE)}  # of a step with several inputs


def step_settings(values: bpy.types.PropertyGroup, step: str) -> tuple[str, ...]:
    """Names of the settings of a step that are in use, as in the panel.

    step: "octree", "light", "codes", "view", or a part of the view's, "cameras" or "importance".
    """
    return tuple(row.name for row in rows(*_PARTS.get(step, (step,))) if row.counts(values))


def recorded(values: bpy.types.PropertyGroup, *steps: str) -> dict[str, Any]:
    """Record the values of the steps' settings for a later comparison, as JSON has them."""
    found = {}
    for step in steps:
        for name in step_settings(values, step):
            if TABLE[name].effect is Effect.ALWAYS:
                value = getattr(values, name)
                found[name] = list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
    return found


def changed(values: bpy.types.PropertyGroup, before: dict[str, Any], *steps: str) -> str:
    """Name in the panel of a changed setting of the steps, or ""."""
    now = recorded(values, *steps)
    for name in now:
        if name not in before or before[name] != now[name]:
            return str(values.bl_rna.properties[name].name)
    return ""


@dataclass(frozen=True)
class JobSettings:
    """Settings of a job on a scene.

    surface: voxelized objects and resolution. light: light in the voxels. network: look-ahead. view: cameras and
    refinement. compute: devices and memory. out: folder for files; None writes none.

    Table, properties, arguments and keys use the flat name of each setting, unique among groups:
    `JobSettings.of(depth=8, light="two-lights", budget=0.2)`.
    """

    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    light: LightSettings = field(default_factory=LightSettings)
    network: NetworkSettings = field(default_factory=NetworkSettings)
    view: ViewSettings = field(default_factory=ViewSettings)
    compute: ComputeSettings = field(default_factory=ComputeSettings)
    out: Path | None = None

    def __post_init__(self) -> None:
        if self.view.cycles is not None and not self.light.is_baked:
            other = self.light.kind
            raise SettingError(f"Refine with Cycles needs voxels with light {CYCLES}, not {other}: choose {CYCLES}")

    @classmethod
    def of(cls, **values: Any) -> JobSettings:
        """Sort flat values into their groups; TypeError for an unknown name, SettingError for a wrong value."""
        return cls().changed(**values)

    def changed(self, **values: Any) -> JobSettings:
        """Copy with other values of some settings, by flat names; raises as `of`."""
        of_groups: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            if name not in SETTING_PATHS:
                raise TypeError(f"A job has no setting {name!r}: its settings are {', '.join(SETTING_PATHS)}")
            group, field_name = SETTING_PATHS[name]
            of_groups.setdefault(group, {})[field_name] = value
        own = of_groups.pop("", {})
        groups = {group: replace(getattr(self, group), **mine) for group, mine in of_groups.items()}
        return replace(self, **own, **groups)

    def key(self, stage: str) -> str:
        """Values that results of a stage, "octree", "light" or "codes", depend on, as text."""
        values = self.flat()
        return repr([(name, values[name]) for name in result_fields(stage)])

    @property
    def contents(self) -> Contents:
        """What the octree holds, for estimates of its memory."""
        from ...patchnet_addon.lod.depth import Contents  # imports numba

        return Contents(self.light.color, self.light.has_sides, self.surface.shape == EXACT_SHAPE)

    def flat(self) -> dict[str, Any]:
        """All values by their flat names."""
        return {
            name: getattr(getattr(self, group) if group else self, field_name)
            for name, (group, field_name) in SETTING_PATHS.items()
        }


# Path to each setting by its flat name: the group that holds it, "" for `JobSettings` itself, and its field there.
SETTING_PATHS: dict[str, tuple[str, str]] = {
    name: (item.name, field_name)
    for item in fields(JobSettings)
    if item.default_factory is not MISSING
    for name, field_name in fields_by_flat_name(item.default_factory).items()
} | {"out": ("", "out")}
