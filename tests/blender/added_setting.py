# SPDX-License-Identifier: GPL-3.0-or-later
"""Declare two settings at run time and find them wherever settings are, in a process of its own.

    python -m patchnet.tests.blender.added_setting WEIGHTS FOLDER

Each is one field of a group. All else is imported afterwards, as it would be with the field in the group's file.
"""

import argparse
import json
import sys
from dataclasses import make_dataclass
from pathlib import Path

import bpy
import pytest

import patchnet
from patchnet.operators.schema.setting import Effect, Kind, Place, Setting
from patchnet.operators.schema.values import CYCLES, LIGHT, VIEW
from patchnet.operators.settings import groups
from patchnet.patchnet_addon.runtime import bounds
from patchnet.patchnet_addon.runtime.errors import SettingError

GLOW = Setting(
    "Glow", "Strength of the glow", LIGHT, Kind.NUMBER, 0.5, bounds.NOISE_THRESHOLD,
    counts=lambda values: values.light == CYCLES, help="strength of the glow",
)  # fmt: skip
GRAIN = Setting("Film Grain", "Grain of the film", VIEW, Kind.SWITCH, True, place=Place.ADVANCED)
HOST = Setting("Host", "Host that bakes", LIGHT, Kind.TEXT, (), effect=Effect.NEVER, argument="")


def declare() -> None:
    """Add the fields to their groups."""
    light = [("glow", float, GLOW.as_field()), ("host", tuple[str, ...], HOST.as_field())]
    view = [("grain", bool, GRAIN.as_field())]
    groups.LightSettings = make_dataclass("LightSettings", light, bases=(groups.LightSettings,), frozen=True)
    groups.ViewSettings = make_dataclass("ViewSettings", view, bases=(groups.ViewSettings,), frozen=True)


def check_properties() -> None:
    """Scene and operators have them, with label, default and bounds."""
    for values in (bpy.context.scene.patchnet.bl_rna, bpy.ops.patchnet.run_all.get_rna_type()):
        glow, grain = values.properties["glow"], values.properties["grain"]
        assert (glow.name, glow.description, glow.default) == ("Glow", "Strength of the glow", 0.5)
        assert (glow.hard_max, grain.name, grain.default) == (1.0, "Film Grain", True)
    assert "glow" in bpy.ops.patchnet.bake_light.get_rna_type().properties
    assert "glow" not in bpy.ops.patchnet.render_preview.get_rna_type().properties


def check_panels() -> None:
    """Panels show them after the other fields of their stage, where they are in use."""
    from patchnet.operators.ui import stages
    from patchnet.tests.blender.drawn import drawn

    values = bpy.context.scene.patchnet
    shown = [name for name in drawn(stages.PATCHNET_PT_light) if name in values.bl_rna.properties]
    assert shown.index("gloss") + 1 == shown.index("glow") < shown.index("cells")
    shown = [name for name in drawn(stages.PATCHNET_PT_preview) if name in values.bl_rna.properties]
    assert shown[-1] == "grain"
    values.light = "two-lights"
    assert "glow" not in drawn(stages.PATCHNET_PT_light)
    values.light = "cycles"


def check_command(folder: Path) -> None:
    """Commands take them, and their help has them after the other fields of their stage."""
    from patchnet.commands import octree, run
    from patchnet.commands.shared.job_arguments import job_settings

    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    text, flags = parser.format_help(), list(parser._option_string_actions)
    assert "strength of the glow (0.5)" in " ".join(text.split())
    assert flags.index("--sides") + 1 == flags.index("--glow") == flags.index("--weights") - 1
    assert flags.index("--heatmap-max") < flags.index("--grain") + 1 == flags.index("--no-grain")
    assert "--host" not in flags
    given = job_settings(parser.parse_args(["a.blend", "--glow", "0.25", "--no-grain"]), folder)
    assert (given.light.glow, given.view.grain) == (0.25, False)
    with pytest.raises(SettingError, match=r"--glow 2\.0 is outside"):
        parser.parse_args(["a.blend", "--glow", "2"])
    other = argparse.ArgumentParser()
    octree.add_arguments(other)
    assert "--glow" in other.format_help() and "--grain" not in other.format_help()


def check_keys() -> None:
    """A value outside the bounds is an error; other values have other keys; what only computes has not."""
    from patchnet.operators.pipeline.voxels_key import surface_key
    from patchnet.operators.properties.job import scene_settings
    from patchnet.operators.settings.job_settings import JobSettings

    depsgraph, settings = bpy.context.evaluated_depsgraph_get(), JobSettings()
    assert surface_key(depsgraph, JobSettings.of(glow=0.25)) != surface_key(depsgraph, settings)
    assert JobSettings.of(glow=0.25).key(LIGHT) != settings.key(LIGHT)
    for same in ({"grain": False}, {"host": ("other",)}):
        assert surface_key(depsgraph, settings.changed(**same)) == surface_key(depsgraph, settings)
    assert repr(settings.changed(host=("other",))) == repr(settings)
    with pytest.raises(SettingError, match="is outside"):
        JobSettings.of(glow=2.0)
    bpy.context.scene.patchnet.glow = 0.25
    assert scene_settings(bpy.context.scene).light.glow == 0.25
    bpy.context.scene.patchnet.property_unset("glow")


def check_job(folder: Path) -> None:
    """Octree and report record them, and another value makes the step stale."""
    from patchnet.operators.session import results
    from patchnet.operators.ui.stages import PATCHNET_PT_light, PATCHNET_PT_preview
    from patchnet.patchnet_addon.octree.file import load_octree
    from patchnet.tests.blender.drawn import drawn
    from patchnet.tests.blender.job_scene import SMALL

    values = bpy.context.scene.patchnet
    values.grain = False
    bpy.ops.patchnet.run_all(**SMALL, max_samples=2, out=str(folder))
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert report["light"]["glow"] == load_octree(folder / "octree.safetensors").provenance["glow"] == 0.5
    assert report["settings"]["grain"] is False and "host" not in report["light"]
    assert results.result_of(bpy.context.scene).why("light") == ""
    said = [*drawn(PATCHNET_PT_light), *drawn(PATCHNET_PT_preview)]
    assert not any(text.endswith(" again") for text in said)
    values.glow, values.grain, values.host = 0.75, True, "other"
    assert "'Glow' changed: bake again" in drawn(PATCHNET_PT_light)
    assert "'Film Grain' changed: render again" in drawn(PATCHNET_PT_preview)


def main() -> None:
    """Declare, register, check."""
    weights, folder = map(Path, sys.argv[1:])
    declare()
    patchnet.register()
    from patchnet.tests.blender.job_scene import build

    build()
    bpy.context.scene.patchnet.weights = str(weights)
    check_properties()
    check_panels()
    check_command(folder)
    check_keys()
    check_job(folder)
    patchnet.unregister()
    print("found everywhere")


if __name__ == "__main__":
    main()
