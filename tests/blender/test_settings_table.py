# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of settings, and what is derived from it: keys, what makes steps stale, properties and arguments."""

from dataclasses import fields, replace
from pathlib import Path

import bpy
import pytest

from patchnet.operators.render_engine.surface_key import surface_key
from patchnet.operators.schema.setting import Effect
from patchnet.operators.schema.table import CODES, LIGHT, OCTREE, TABLE, rows
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.settings.step_settings import recorded
from patchnet.operators.ui.properties import scene_settings
from patchnet.tests.blender.job_scene import build

pytestmark = pytest.mark.usefixtures("registered")

OTHER = {
    "scope": "SELECTED", "depth": 5, "voxel_size_world": 0.1, "fit": True, "memory_bytes": 2**30, "light": "two-lights",
    "samples": 3, "texel_voxels": 1.0, "both_sides": True, "exposure": 2.0, "color": True, "weights": Path("other"),
}  # fmt: skip


@pytest.mark.parametrize("field", OTHER)
def test_renders_that_differ_in_a_setting_share_no_voxels(field: str) -> None:
    build()
    for item in bpy.context.scene.objects:
        item.select_set(True)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    settings = JobSettings()
    assert surface_key(depsgraph, replace(settings, **{field: OTHER[field]})) != surface_key(depsgraph, settings)


def test_every_setting_of_the_octree_is_tried() -> None:
    known = {row.job_field for row in rows(OCTREE, LIGHT, CODES) if row.effect is not Effect.NEVER}
    assert known - {"track"} == set(OTHER), "a new setting gets another value here; a track only comes with fit"


def test_devices_change_no_key() -> None:
    build()
    depsgraph, settings = bpy.context.evaluated_depsgraph_get(), JobSettings()
    assert surface_key(depsgraph, replace(settings, device="CPU", encoder_device="CPU")) == surface_key(
        depsgraph, settings
    )
    assert repr(replace(settings, device="CPU")) == repr(settings)


def test_every_setting_is_a_property_and_a_field() -> None:
    properties = bpy.context.scene.patchnet.bl_rna.properties
    names = {field.name for field in fields(JobSettings)}
    for row in TABLE.values():
        assert (properties[row.name].name, properties[row.name].description) == (row.label, row.description)
        assert row.job_field in names


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
    assert found.budget == pytest.approx(0.3), "Blender keeps single precision"
    assert replace(found, budget=JobSettings.budget) == JobSettings()
