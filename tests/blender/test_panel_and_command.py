# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel and `patchnet run` have the same settings and defaults; exceptions are listed."""

import argparse
from pathlib import Path

import bpy
import pytest

from patchnet.commands import run
from patchnet.commands.shared.job_arguments import job_settings
from patchnet.operators.properties.job import scene_settings
from patchnet.operators.properties.preferences import PatchNetPreferences
from patchnet.operators.properties.stages import DerivedProperties
from patchnet.operators.render_engine.panels import PATCHNET_PT_render_refinement
from patchnet.operators.settings.groups import SurfaceSettings, ViewSettings
from patchnet.operators.settings.job_settings import TABLE
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.tests.blender.drawn import TABS, drawn, settings_drawn
from patchnet.tests.blender.job_scene import build

pytestmark = pytest.mark.usefixtures("registered")

# Properties of the panel that an argument of another name sets; all others have the argument's name, or the table's.
OF_ARGUMENT = {
    "--depth": {"resolution", "depth"},
    "--size": {"size_x", "size_y"},
    "--mask-image": {"importance", "importance_image"},
    "--mask-group": {"importance", "importance_group"},
    "--frames": {"frame_start", "frame_end", "frame_step"},  # the scene's own
    "--overwrite": {"skip_existing"},
}
ONLY_COMMAND = {
    "--colormap": "in the preferences, since it belongs to a user",
}
ONLY_PANEL = {
    "level": "`patchnet export --level`: voxels are exported from the run's octree",
    "limit": "of an object in the viewport",
}


def parser() -> argparse.ArgumentParser:
    found = argparse.ArgumentParser()
    run.add_arguments(found)
    return found


def arguments() -> set[str]:
    """Arguments of `patchnet run`, each by its first spelling."""
    return {action.option_strings[0] for action in parser()._actions if action.option_strings} - {"-h"}


def properties_of(argument: str) -> set[str]:
    """Properties of the panel that an argument sets."""
    by_table = {row.flag: row.name for row in TABLE.values() if row.flag}
    name = by_table.get(argument, argument.removeprefix("--").replace("-", "_"))
    return OF_ARGUMENT.get(argument, {name})


def drawn_settings() -> set[str]:
    """Names of the settings that the tab's panels show, whatever is chosen in them."""
    for name in DerivedProperties.__annotations__:
        if name.startswith("use_"):
            setattr(bpy.context.scene.patchnet, name, True)  # its number is shown
    return set().union(*map(settings_drawn, TABS))


def test_every_argument_is_in_the_panel() -> None:
    build()
    shown = drawn_settings()
    missing = {item: properties_of(item) - shown for item in arguments() - set(ONLY_COMMAND)}
    assert not {item: names for item, names in missing.items() if names}
    assert set(ONLY_COMMAND) <= arguments(), "an exception that is none any more"
    assert "colormap" in PatchNetPreferences.__annotations__


def test_every_setting_of_the_panel_is_an_argument() -> None:
    build()
    settable = set().union(*(properties_of(item) for item in arguments()))
    assert drawn_settings() - settable - set(DerivedProperties.__annotations__) == set(ONLY_PANEL)


def test_every_setting_of_a_scene_is_in_the_panel() -> None:
    build()
    names = {item.identifier for item in bpy.context.scene.patchnet.bl_rna.properties} - {"rna_type", "name"}
    of_renders = set(drawn(PATCHNET_PT_render_refinement))
    bpy.context.scene.patchnet.track = True
    assert names - drawn_settings() - of_renders == {"size"}, "whose two sides are shown"


def test_defaults_are_the_same() -> None:
    build()
    bpy.context.scene.property_unset("patchnet")
    given = job_settings(parser().parse_args(["scene.blend"]), Path("out"))
    assert given.view.size == (192, 192)  # square pictures, while the panel's follow the render's aspect
    scene = scene_settings(bpy.context.scene).changed(budget=ViewSettings.budget)
    assert given.network.torch_device == scene.network.torch_device == "auto"
    assert given.changed(size=scene.view.size, out=None, network_device="AUTO") == scene


def test_settings_that_arguments_give() -> None:
    def given(*words: str) -> object:
        return job_settings(parser().parse_args(["scene.blend", *words]), Path("out"))

    assert given("--bake-device", "gpu").light.device == "GPU" and given().light.device == "AUTO"
    assert given("--no-color").light.color is False and given("--color").light.color is given().light.color is True
    assert given().surface == given("--depth", "auto").surface == SurfaceSettings()
    assert given("--depth", "7").surface.depth == 7 and given("--voxel-size", "2").surface.voxel_size_world == 2.0
    with pytest.raises(SettingError, match="Depth 'fit' is neither a whole number nor 'auto'"):
        given("--depth", "fit")
    resolution = bpy.context.scene.patchnet.bl_rna.properties["resolution"]
    assert set(resolution.enum_items.keys()) == {"AUTO", "DEPTH", "VOXEL_SIZE"} and resolution.default == "AUTO"
    assert given("--memory", "4").surface.memory_bytes == 4 * 2**30
    assert given("--mask-image", "Mask").view.importance.image == "Mask"
    assert given("--mask-group", "Head").view.importance.vertex_group == "Head"
    with pytest.raises(SettingError, match="Importance needs one source"):
        given("--mask-image", "Mask", "--mask-group", "Head")
