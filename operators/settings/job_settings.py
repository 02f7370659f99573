# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a job in four groups, the table of all settings, and records of their values."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.lod.memory import Contents
from ...patchnet_addon.runtime.errors import SettingError
from ..schema.setting import Effect, Kind, Setting, names_of, rows_of
from ..schema.values import CAMERAS, CYCLES, EXACT_SHAPE, IMPORTANCE, LIGHT, NOTHING, OCTREE, OUTPUT, VIEW
from .cycles_settings import CyclesSettings
from .groups import LightSettings, NetworkSettings, SurfaceSettings, ViewSettings

if TYPE_CHECKING:
    import bpy

ESTIMATED = (OCTREE, LIGHT, CAMERAS)  # inputs of an estimate
_PARTS = {VIEW: (CAMERAS, VIEW, IMPORTANCE)}  # of a step with several inputs


def rows(*stages: str) -> list[Setting]:
    """Settings of some stages, in the order of the table."""
    return [row for row in TABLE.values() if row.stage in stages]


def recorded(values: Any, *steps: str) -> dict[str, Any]:
    """Record the values of the steps' settings that are in use, for a later comparison or a file, as JSON has them.

    values: the properties of a scene, or `values` of a job. steps: "octree", "light", "codes", "view", or a part of the
    view's, "cameras" or "importance".
    """
    found = {}
    for row in rows(*(stage for step in steps for stage in _PARTS.get(step, (step,)))):
        if row.effect is Effect.ALWAYS and row.counts(values):
            value = getattr(values, row.name)
            found[row.name] = list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
    return found


def changed(values: bpy.types.PropertyGroup, before: dict[str, Any], *steps: str) -> str:
    """Name in the panel of a changed setting of the steps, or ""."""
    for name, value in recorded(values, *steps).items():
        if name not in before or before[name] != value:
            return TABLE[name].label
    return ""


def result_fields(*stages: str) -> list[str]:
    """Names in `JobSettings` of the settings on which the results of some stages may depend."""
    return [row.name for row in rows(*stages) if row.effect is not Effect.NEVER and row.name in SETTING_PATHS]


@dataclass(frozen=True)
class JobSettings:
    """Settings of a job on a scene.

    surface: voxelized objects and resolution. light: light in the voxels. network: look-ahead. view: cameras and
    refinement. out: folder for files; None writes none.

    Properties, arguments and keys use the name of each setting in the table, unique among groups:
    `JobSettings.of(depth=8, light="two-lights", budget=0.2)`.
    """

    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    light: LightSettings = field(default_factory=LightSettings)
    network: NetworkSettings = field(default_factory=NetworkSettings)
    view: ViewSettings = field(default_factory=ViewSettings)
    out: Path | None = Setting(
        "Output", "Folder for pictures, octree and report; empty saves nothing", OUTPUT, Kind.FOLDER,
        effect=Effect.NEVER, argument="", automatic="No Files",
    ).as_field()  # fmt: skip

    def __post_init__(self) -> None:
        if self.view.cycles is not None and not self.light.is_baked:
            other = self.light.kind
            raise SettingError(f"Refine with Cycles needs voxels with light {CYCLES}, not {other}: choose {CYCLES}")

    @classmethod
    def of(cls, **values: Any) -> JobSettings:
        """Sort values into their groups; TypeError for an unknown name, SettingError for a wrong value."""
        return cls().changed(**values)

    def changed(self, **values: Any) -> JobSettings:
        """Copy with other values of some settings, by their names; raises as `of`."""
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
        values = self.values
        return repr([(name, getattr(values, name)) for name in result_fields(stage)])

    @property
    def values(self) -> SimpleNamespace:
        """All values by their names, those of properties too."""
        found = {
            name: getattr(getattr(self, group) if group else self, field_name)
            for name, (group, field_name) in SETTING_PATHS.items()
        }
        painted = self.view.importance
        found |= {"resolution": self.surface.resolution, "importance": NOTHING} | (painted.choice if painted else {})
        return SimpleNamespace(**found)

    @property
    def contents(self) -> Contents:
        """What the octree holds, for estimates of its memory."""
        return Contents(self.light.color, self.light.has_sides, self.surface.shape == EXACT_SHAPE)


_GROUPS: dict[str, Any] = {item.name: item.default_factory for item in fields(JobSettings) if item.name != "out"}
# Path to each setting by its name: the group that holds it, "" for `JobSettings` itself, and its field there.
SETTING_PATHS: dict[str, tuple[str, str]] = {
    name: (group, field_name) for group, kind in _GROUPS.items() for name, field_name in names_of(kind).items()
} | {"out": ("", "out")}
# All settings by name, in the order of panels, helps and records.
TABLE: dict[str, Setting] = {
    row.name: row for kind in (*_GROUPS.values(), JobSettings, CyclesSettings) for row in rows_of(kind)
}
