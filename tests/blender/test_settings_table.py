# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of settings, and what is derived from it: keys, what makes steps stale, properties and arguments."""

from pathlib import Path

import bpy
import pytest

from patchnet.operators.properties import scene_settings
from patchnet.operators.render_engine.frame_octree import surface_key
from patchnet.operators.schema.setting import Effect
from patchnet.operators.schema.table import CODES, LIGHT, OCTREE, TABLE, rows
from patchnet.operators.settings.cycles_settings import CyclesSettings
from patchnet.operators.settings.groups import (
    ComputeSettings,
    LightSettings,
    NetworkSettings,
    SurfaceSettings,
    ViewSettings,
)
from patchnet.operators.settings.job_settings import GROUP_OF, JobSettings, groups_of_rows, recorded, setting_paths
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.tests.blender.job_scene import build

pytestmark = pytest.mark.usefixtures("registered")

OTHER = {
    "scope": "SELECTED", "depth": 5, "voxel_size_world": 0.1, "fit": True, "memory_bytes": 2**30, "light": "two-lights",
    "samples": 3, "texel_voxels": 1.0, "both_sides": True, "exposure": 2.0, "color": False, "weights": Path("other"),
    "gloss": "off", "denoise": False,
}  # fmt: skip


@pytest.mark.parametrize("field", OTHER)
def test_renders_that_differ_in_a_setting_share_no_voxels(field: str) -> None:
    build()
    for item in bpy.context.scene.objects:
        item.select_set(True)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    settings = JobSettings()
    assert surface_key(depsgraph, settings.changed(**{field: OTHER[field]})) != surface_key(depsgraph, settings)


def test_every_setting_of_the_octree_is_tried() -> None:
    known = {row.job_field for row in rows(OCTREE, LIGHT, CODES) if row.effect is not Effect.NEVER}
    assert known - {"track"} == set(OTHER), "a new setting gets another value here; a track only comes with fit"


def test_devices_change_no_key() -> None:
    build()
    depsgraph, settings = bpy.context.evaluated_depsgraph_get(), JobSettings()
    other = settings.changed(device="CPU", network_device="CPU", torch_python=Path("other"))
    assert other != settings
    assert surface_key(depsgraph, other) == surface_key(depsgraph, settings)
    assert repr(other) == repr(settings)


def test_devices_of_the_network_as_torch_names_them() -> None:
    given = ("AUTO", "CPU", "GPU", "auto", "cpu", "cuda", "cuda:1")
    found = [ComputeSettings(network_device=name).torch_device for name in given]
    assert found == ["auto", "cpu", "cuda", "auto", "cpu", "cuda", "cuda:1"]


def test_every_setting_is_a_property_and_a_field() -> None:
    properties = bpy.context.scene.patchnet.bl_rna.properties
    names = JobSettings().flat()
    for row in TABLE.values():
        assert (properties[row.name].name, properties[row.name].description) == (row.label, row.description)
        assert row.job_field in names


def test_flat_names_are_sorted_into_groups() -> None:
    assert {GROUP_OF[name] for name in TABLE} == {"surface", "light", "network", "view", "compute", ""}
    of_groups = {
        name: GROUP_OF[name] for name in ("resolution", "light", "weights", "importance_image", "device", "out")
    }
    assert list(of_groups.values()) == ["surface", "light", "network", "view", "compute", ""]
    settings = JobSettings.of(depth=5, light="two-lights", weights=Path("w"), size=(3, 2), device="CPU", out=Path("o"))
    assert settings == JobSettings(
        SurfaceSettings(depth=5),
        LightSettings(kind="two-lights"),
        NetworkSettings(Path("w")),
        ViewSettings(size=(3, 2)),
        ComputeSettings(device="CPU"),
        Path("o"),
    )
    assert JobSettings.of(**settings.flat()) == settings == settings.changed()
    assert settings.changed(depth=None, voxel_size_world=0.1).surface.voxel_size_world == 0.1
    with pytest.raises(TypeError, match=r"A job has no setting 'sample': its settings are .*samples"):
        JobSettings.of(sample=3)


def test_a_setting_stands_in_one_group() -> None:
    known = setting_paths({"light": LightSettings}, ["out"])
    assert known["light"] == ("light", "kind") and known["out"] == ("", "out")
    with pytest.raises(TypeError, match="Setting 'samples' stands in 'light' and in 'cycles': rename one of them"):
        setting_paths({"light": LightSettings, "cycles": CyclesSettings}, [])
    with pytest.raises(TypeError, match="Setting 'scope' of the table has no field 'scope' in a group: add one"):
        groups_of_rows(TABLE.values(), known)


@pytest.mark.parametrize(
    ("group", "values", "sentence"),
    [
        (SurfaceSettings, {"depth": 5, "voxel_size_world": 0.1}, "Depth and voxel size are both given"),
        (SurfaceSettings, {"depth": 99}, "Depth 99 is outside"),
        (LightSettings, {"kind": "moon"}, "There is no light 'moon': choose cycles or two-lights"),
        (LightSettings, {"samples": 0}, "Samples per texel 0 is outside"),
        (ViewSettings, {"strategy": "guess"}, "guess"),
        (ViewSettings, {"size": (4, -1)}, "-1 is outside"),
        (ViewSettings, {"colormap": "gray"}, "There is no color map 'gray'"),
        (
            ComputeSettings,
            {"network_device": "TPU"},
            r"The network's device \(Network On\) 'tpu' is unknown: choose auto, cpu, cuda",
        ),
        (ComputeSettings, {"memory_bytes": 1}, "is outside"),
        (
            JobSettings,
            {"view": ViewSettings(cycles=CyclesSettings()), "light": LightSettings(kind="two-lights")},
            "Regions by Cycles need voxels in Cycles' light, not two-lights: choose cycles",
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
    values.samples, values.both_sides, values.device = 99, True, "CPU"
    assert recorded(values, LIGHT) == before
    values.light = "cycles"
    assert recorded(values, LIGHT) != before and "device" not in recorded(values, LIGHT)


def test_scene_and_table_have_the_same_defaults() -> None:
    build()
    bpy.context.scene.property_unset("patchnet")
    found = scene_settings(bpy.context.scene)
    assert found.view.budget == pytest.approx(0.3), "Blender keeps single precision"
    assert found.changed(budget=ViewSettings.budget) == JobSettings()
