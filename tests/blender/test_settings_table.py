# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of settings, and what is derived from it: keys, what makes steps stale, properties and arguments."""

from pathlib import Path

import bpy
import pytest

from patchnet.operators.pipeline.voxels_key import surface_key
from patchnet.operators.schema.setting import Effect, Kind, Setting
from patchnet.operators.schema.values import CODES, LIGHT, OCTREE
from patchnet.operators.settings.cycles_settings import CyclesSettings
from patchnet.operators.settings.groups import LightSettings, NetworkSettings, SurfaceSettings, ViewSettings
from patchnet.operators.settings.job_settings import SETTING_PATHS, JobSettings, recorded, rows
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from patchnet.tests.blender.job_scene import build

pytestmark = pytest.mark.usefixtures("registered")

KEYED = [row for row in rows(OCTREE, LIGHT, CODES) if row.effect is not Effect.NEVER and row.name in SETTING_PATHS]


def other(row: Setting) -> object:
    """Another value of a setting than its default."""
    if row.kind is Kind.CHOICE:
        return [value for value, _, _ in row.choices if value not in (row.default, row.shown)][-1]
    if row.kind is Kind.SWITCH:
        return not row.default
    return {Kind.FILE: Path("other"), Kind.PAIR: (1, 2)}.get(row.kind, 2 * (row.default or 1))


@pytest.mark.parametrize("row", KEYED, ids=lambda row: row.name)
def test_renders_that_differ_in_a_setting_share_no_voxels(row: Setting) -> None:
    build()
    for item in bpy.context.scene.objects:
        item.select_set(True)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    settings = JobSettings()
    assert surface_key(depsgraph, settings.changed(**{row.name: other(row)})) != surface_key(depsgraph, settings)


def test_devices_change_no_key() -> None:
    build()
    depsgraph, settings = bpy.context.evaluated_depsgraph_get(), JobSettings()
    other = settings.changed(device="CPU", network_device="CPU")
    assert other != settings
    assert surface_key(depsgraph, other) == surface_key(depsgraph, settings)
    assert repr(other) == repr(settings)


@pytest.mark.parametrize(
    ("group", "values", "sentence"),
    [
        (SurfaceSettings, {"depth": 5, "voxel_size_world": 0.1}, "Depth and voxel size are both given"),
        (SurfaceSettings, {"depth": 99}, "Depth 99 is outside"),
        (SurfaceSettings, {"track": True, "depth": 7}, "can follow a track"),
        (SurfaceSettings, {"track": True, "voxel_size_world": 0.1}, "can follow a track"),
        (LightSettings, {"kind": "moon"}, "Light 'moon' is unknown: choose one of cycles, two-lights"),
        (LightSettings, {"max_samples": 0}, "Max samples of baked light 0 is outside"),
        (LightSettings, {"cells": "all"}, "choose one of seen, everywhere"),
        (LightSettings, {"gloss": "sideways"}, "auto, off, above, camera"),
        (CyclesSettings, {"budget": 1.5}, "is outside"),
        (CyclesSettings, {"samples": 0}, "is outside"),
        (CyclesSettings, {"light": "glossy"}, "'glossy' is unknown: choose one"),
        (ViewSettings, {"strategy": "guess"}, "guess"),
        (ViewSettings, {"size": (4, -1)}, "-1 is outside"),
        (ViewSettings, {"spp": 1025.0}, "Samples per pixel 1025.0 is outside"),
        (ViewSettings, {"unrefined": "guessed"}, "choose one of preview, predicted"),
        (ViewSettings, {"colormap": "gray"}, "There is no color map 'gray'"),
        (
            NetworkSettings,
            {"device": "TPU"},
            r"The network's device \(Network Device\) 'tpu' is unknown: choose auto, cpu, cuda",
        ),
        (SurfaceSettings, {"memory": 1e-9}, "is outside"),
        (
            JobSettings,
            {"view": ViewSettings(cycles=CyclesSettings()), "light": LightSettings(kind="two-lights")},
            "Refine with Cycles needs voxels with light cycles, not two-lights: choose cycles",
        ),
    ],
)
def test_each_group_checks_its_own_values(group: type, values: dict, sentence: str) -> None:
    with pytest.raises(SettingError, match=sentence):
        group(**values)


def test_settings_that_do_not_count_make_nothing_stale() -> None:
    values = bpy.context.scene.patchnet
    values.light = "two-lights"
    before = recorded(values, LIGHT)
    values.max_samples, values.device = 99, "CPU"
    assert recorded(values, LIGHT) == before
    values.light = "cycles"
    assert recorded(values, LIGHT) != before and "device" not in recorded(values, LIGHT)


OF_1_0_0 = (
    "patchnet-plus", "patchnet-plus-1", "patchnet-plus-0", "patchnet-plus-staged", "patchnet-behind", "patchnet",
    "ss-variance", "random", "patchnet-behind-exact", "patchnet-exact", "optimal",
)  # fmt: skip


@pytest.mark.parametrize("name", OF_1_0_0)
def test_strategies_of_older_files(name: str, tmp_path: Path) -> None:
    """A file holds a number; a strategy that is gone becomes the default."""
    build()
    bpy.context.scene.patchnet["strategy"] = OF_1_0_0.index(name)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert bpy.context.scene.patchnet.strategy == (name if name in STRATEGIES else DEFAULT)
