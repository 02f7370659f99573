# SPDX-License-Identifier: GPL-3.0-or-later
"""The catalogue of scenes: errors of missing files, octrees that are made once."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from patchnet.commands import make_parser
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.runtime.errors import SceneError, SettingError
from patchnet.training.commands import RESEARCH
from patchnet.training.commands.lab.evaluate import _octrees
from patchnet.training.commands.lab.scene_arguments import scenes_named
from patchnet.training.evaluation import catalogue
from patchnet.training.evaluation.catalogue import (
    CYCLES,
    FOLDER,
    OWN_SCENES,
    SCENES,
    TWO_LIGHTS,
    Scene,
    scene_named,
    scene_octree,
)

blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="Blender is not installed")
TRIANGLES = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nf 1 2 3\nf 1 3 4\n"
SMALL = Scene("small", "Small", "small.obj", TWO_LIGHTS, "a test", "none", depth=4, bisect=("x", 0.5))


def test_unknown_scene_names_those_there_are() -> None:
    with pytest.raises(SettingError, match=r"Unknown scene 'spoonza'.*sponza"):
        scene_named("spoonza")


def test_missing_folder_and_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(FOLDER, raising=False)
    with pytest.raises(SceneError, match=FOLDER):
        SMALL.path()
    assert SCENES["courtyard"].path() == Path("demo")
    assert {scene.name for scene in scenes_named("all")} == {
        scene.name for scene in SCENES.values() if scene.file in OWN_SCENES
    }
    monkeypatch.setenv(FOLDER, str(tmp_path / "none"))
    with pytest.raises(SceneError, match="not a folder"):
        SMALL.path()
    monkeypatch.setenv(FOLDER, str(tmp_path))
    with pytest.raises(SceneError, match=r"needs small\.obj"):
        SMALL.path()


def test_missing_composed_file_says_how_to_make_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    composed = [scene for scene in SCENES.values() if scene.composed]
    assert len(composed) == 2
    for scene in composed:
        assert not scene.is_there()
        made = f"make it by `patchnet lab {scene.composed} --out {tmp_path / scene.file}`"
        with pytest.raises(SceneError, match=re.escape(made)):
            scene.path()
        make_parser(more=RESEARCH).parse_args(["lab", *scene.composed.split(), "--out", scene.file])
        (tmp_path / scene.file).touch()
        assert scene.is_there() and scene.path() == tmp_path / scene.file


def test_all_scenes_are_those_whose_files_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(catalogue, "scene_octree", lambda scene, folder: folder / scene.name)
    monkeypatch.setenv(FOLDER, str(tmp_path))
    (tmp_path / "sponza_crytek.glb").touch()
    args = SimpleNamespace(scenes="all", octrees=[], out=tmp_path)
    found = _octrees(args)
    assert found == {name: tmp_path / "octrees" / name for name in ("sponza", "courtyard")}
    said = capsys.readouterr().err
    assert "furnished-room (furnished_room.glb)" in said and "shuttle (ldraw_space_shuttle.glb)" in said
    assert "sponza" not in said
    monkeypatch.delenv(FOLDER)
    assert list(_octrees(args)) == ["courtyard"], "which needs no folder"


def test_arguments_say_only_what_counts() -> None:
    assert SMALL.arguments() == ["--depth", "4", "--light", "two-lights", "--sides", "one", "--bisect", "x", "0.5"]
    lit = replace(SMALL, light=CYCLES, max_samples=8, without=("ivy", "rose"), bisect=None)
    of_cycles = ["--depth", "4", "--light", "cycles", "--sides", "one", "--max-samples", "8", "--without", "ivy,rose"]
    assert lit.arguments() == of_cycles


@blender
def test_octree_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    source, folder = tmp_path / "small.obj", tmp_path / "octrees"
    source.write_text(TRIANGLES)
    path = scene_octree(SMALL, folder)
    octree = load_octree(path)
    assert octree.depth == 4 and octree.provenance["bisect"] == ["x", "0.5"]
    assert list(folder.iterdir()) == [path]
    monkeypatch.setattr(catalogue, "_make", lambda *_: pytest.fail("it is there"))
    assert scene_octree(replace(SMALL, title="Other"), folder) == path
    monkeypatch.setattr(catalogue, "_make", lambda scene, source, out: out.write_bytes(path.read_bytes()))
    others = [scene_octree(replace(SMALL, depth=5), folder)]
    monkeypatch.setattr(catalogue, "source_hash", lambda *_: "other code")
    others.append(scene_octree(SMALL, folder))
    source.write_text(TRIANGLES + "\n")
    others.append(scene_octree(SMALL, folder))
    assert len({path, *others}) == 4


@blender
def test_scene_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    (tmp_path / "small.obj").write_text("no scene")
    with pytest.raises(SceneError, match=r"'small' did not become an octree: .* ended with code 2"):
        scene_octree(SMALL, tmp_path / "octrees")
    assert list((tmp_path / "octrees").iterdir()) == []
