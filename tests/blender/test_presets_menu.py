# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the panel: shipped ones and the user's."""

from pathlib import Path

import bpy
import pytest

from patchnet.operators.ui import presets_menu

pytestmark = pytest.mark.usefixtures("scene")


def shipped() -> dict[str, Path]:
    (folder,) = [path for path in map(Path, bpy.utils.preset_paths("patchnet")) if "operators" in path.parts]
    return {path.stem: path for path in folder.glob("*.py")}


def apply(path: Path) -> None:
    """As an entry of the menu does."""
    menu = presets_menu.PATCHNET_PT_presets
    assert bpy.ops.script.execute_preset(filepath=str(path), menu_idname=menu.__name__) == {"FINISHED"}


def test_presets_are_shipped_and_apply(scene: bpy.types.Scene) -> None:
    assert set(shipped()) == {"Draft", "Standard", "Large_Pictures"}
    settings = scene.patchnet
    defaults = {name: value_of(settings, name) for name in presets_menu._VALUES}
    assert {"budget", "spp"} <= set(defaults)
    for name, path in shipped().items():
        settings.spp = 9.0
        apply(path)
        assert (defaults == {key: value_of(settings, key) for key in presets_menu._VALUES}) == (name == "Standard")
        assert settings.spp == 0.0, "each says which budget"
    apply(shipped()["Large_Pictures"])
    assert settings.resolution == "AUTO" and tuple(settings.size) == (0, 0)


def value_of(settings: bpy.types.PropertyGroup, name: str) -> object:
    value = getattr(settings, name)
    return tuple(value) if name == "size" else value


def test_presets_of_the_user(scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bpy.utils, "user_resource", lambda kind, path="", create=False: made(tmp_path / path))
    scene.patchnet.max_samples, scene.patchnet.budget = 77, 0.25
    assert bpy.ops.patchnet.add_preset(name="Mine") == {"FINISHED"}
    (path,) = tmp_path.rglob("*.py")
    scene.patchnet.max_samples, scene.patchnet.budget = 1, 1.0
    apply(path)
    assert scene.patchnet.max_samples == 77 and scene.patchnet.budget == pytest.approx(0.25)


def made(path: Path) -> str:
    path.mkdir(parents=True, exist_ok=True)
    return str(path)
