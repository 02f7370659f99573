# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab evaluate-cycles`: curves against Cycles, the octree's light, an unchanged scene."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles.camera_render import render_halves
from patchnet.operators.scene.files import open_scene
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.shading import DIRECTION
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.supersample import supersample
from patchnet.tests.blender.objects import cuboid, read
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import simple
from patchnet.training import commands
from patchnet.training.commands.lab.octree_light import as_in_octree, shown_as
from patchnet.training.evaluation import poses
from patchnet.training.evaluation.catalogue import CYCLES, FOLDER, SCENES, TWO_LIGHTS, Scene
from patchnet.training.strategies.registry import EVALUATED

FILE = "bars.obj"
DEPTH = 7
WORDS = ["--cameras", "2", "--samples", "8", "--frames", "20", "--size", "32", "24"]


def save_bars(path: Path) -> None:
    """Ten bars of different height and width on a plate, of two colours, as an .obj file."""
    bpy.ops.wm.read_homefile(use_empty=True)
    light = simple("BsdfPrincipled", "Light", Base_Color=(0.7, 0.6, 0.5, 1.0))
    grey = simple("BsdfPrincipled", "Grey", Base_Color=(0.4, 0.4, 0.4, 1.0))
    cuboid("Plate", (0.0, 0.0, 0.0), (2.0, 2.0, 0.1), light)
    for k in range(10):
        x, y = 0.2 * k, 0.15 * k
        cuboid(f"Bar {k}", (x, y, 0.0), (x + 0.04 + 0.03 * k, y + 0.1, 0.3 + 0.15 * k), light if k % 2 else grey)
    bpy.ops.wm.obj_export(filepath=str(path))


@pytest.fixture
def scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Scene]:
    """Scenes of one file: in Cycles' light, in Two Lights and cut open, in Cycles' light and cut open; catalogued."""
    save_bars(tmp_path / FILE)
    monkeypatch.setenv(FOLDER, str(tmp_path))
    common = {"file": FILE, "source": "a test", "licence": "none", "max_samples": 2, "depth": DEPTH}
    found = {
        "bars": Scene("bars", "Bars", light=CYCLES, **common),
        "bars-cut": Scene("bars-cut", "Bars, cut", light=TWO_LIGHTS, bisect=("x", 0.75), **common),
        "bars-open": Scene("bars-open", "Bars, cut", light=CYCLES, bisect=("x", 0.75), **common | {"max_samples": 64}),
    }
    for name, scene in found.items():
        monkeypatch.setitem(SCENES, name, scene)
    return found


def octree_file(scene: Scene, folder: Path) -> Path:
    path = folder / f"{scene.name}.safetensors"
    assert commands.main(["octree", str(scene.path()), *scene.arguments(), "--out", str(path)]) == 0
    return path


def view(size: int = 48) -> Camera:
    return Camera.look_at(np.array([1.4, -3.2, 2.4]), np.array([0.9, 0.9, 0.4]), size_px=(size, size))


def test_curves_against_cycles(
    scenes: dict[str, Scene], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(poses, "_POSITIONS", 30)  # that a track chooses from
    out, scenes = tmp_path / "out", {name: scenes[name] for name in ("bars", "bars-cut")}
    given = [word for scene in scenes.values() for word in ("--octree", f"{scene.name}={octree_file(scene, tmp_path)}")]
    words = ["lab", "evaluate-cycles", "--scenes", ",".join(scenes), *given, *WORDS]
    assert commands.main([*words, "--out", str(out)]) == 0
    assert "2 scenes" in capsys.readouterr().out
    results = json.loads((out / "cycles.json").read_text())
    assert results["settings"] | {"cameras": 2, "samples": 8} == results["settings"]
    for name, values in results["scenes"].items():
        truths = {"octree", "diffuse", "combined"} if name == "bars" else {"octree", "diffuse"}
        assert values["truths"].keys() == truths
        for truth, found in values["truths"].items():
            curves = np.array(list(found["mse"].values()))
            assert found["mse"].keys() == EVALUATED.keys() and curves.shape == (len(EVALUATED), 101)
            np.testing.assert_allclose(curves[:, 0], curves[0, 0])
            assert curves[0, 0] > 0 and np.abs(curves[:, 100]).max() < 1e-12
            assert (np.array(found["mse"]["optimal"]) <= curves.min(axis=0) + 1e-9 * curves[0, 0]).all()
            if truth != "octree":
                assert 0 < found["bias"] < curves[0, 0] and 0 < found["noise"] < found["bias"]
        assert values["mse"] == values["truths"]["diffuse"]["mse"]
    tables = (out / "cycles.md").read_text()
    assert [tables.count(f"\n| {name} | ") for name in scenes] == [1, 1] and "Scenes of 2 in which" in tables
    figures = {path.name for path in (out / "figures").iterdir()}
    assert figures == {f"{name}-cycles{end}" for name in scenes for end in (".png", ".svg")}


@pytest.mark.parametrize("name", ["bars", "bars-cut", "bars-open"])
def test_light_is_that_of_the_octree_and_the_scene_stays(name: str, scenes: dict[str, Scene], tmp_path: Path) -> None:
    scene = scenes[name]
    octree = load_octree(octree_file(scene, tmp_path))
    open_scene(scene.path())
    before = scene_snapshot()
    with as_in_octree(bpy.context, octree, scene.light, None if scene.bisect is None else (0, scene.bisect[1])):
        first, second = drain(render_halves(bpy.context, view(), 32))
    assert_unchanged(before)
    cycles = octree.exposure * (first.luminance + second.luminance) / 2
    mine = drain(supersample(octree, view(), 8)).luminance.reshape(cycles.shape)
    assert np.clip(cycles, 0, 1).mean() == pytest.approx(mine.mean(), rel=0.05)
    right = cycles[:, 38:]  # of what is left of the cut
    assert (right.max() == 0) == (scene.bisect is not None)


def test_two_lights_are_what_methods_say(empty_scene: None) -> None:
    """A smooth metal, a diffuse surface that is half transparent, and an emitter, seen from above."""
    bpy.ops.mesh.primitive_plane_add(size=4.0)
    material = simple("BsdfPrincipled", Base_Color=(0.5, 0.5, 0.5, 1.0), Metallic=1.0, Alpha=0.5)
    bpy.context.object.data.materials.append(material)
    names = read().material_names
    camera = Camera.look_at(np.array([0.0, -0.1, 2.0]), np.zeros(3), size_px=(8, 8), fov=0.5)
    with shown_as(bpy.context.scene, names, DIRECTION):
        halves = drain(render_halves(bpy.context, camera, 512))
    expected = 0.5 * 0.5 * DIRECTION[2] / np.linalg.norm(DIRECTION)
    assert np.mean([half.luminance for half in halves]) == pytest.approx(expected, rel=0.02)


def test_what_the_camera_sees_through_still_throws_its_shadow(empty_scene: None) -> None:
    """A floor beside a wall that hides a low sun, seen from above, cut open between both."""
    bpy.ops.mesh.primitive_plane_add(size=2.0)
    floor = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(size=2.0, location=(2.1, 0.0, 2.0), scale=(0.1, 2.0, 2.0))
    wall = bpy.context.object
    for thing in (floor, wall):
        thing.data.materials.append(simple("BsdfPrincipled", thing.name))
    bpy.ops.object.light_add(type="SUN", rotation=(0.0, 1.0, 0.0))
    names = read().material_names
    above = Camera.look_at(np.array([1.5, -0.1, 9.0]), np.array([1.5, 0.0, 0.0]), size_px=(32, 8), fov=0.5)

    def brightness() -> tuple[float, float]:
        half, _ = drain(render_halves(bpy.context, above, 16))
        return float(half.luminance[:, :14].mean()), float(half.luminance[:, 16:].mean())

    shadow, top = brightness()
    before = scene_snapshot()
    with shown_as(bpy.context.scene, names, plane=(0, 1.5)):
        open_shadow, open_top = brightness()
    assert_unchanged(before)
    assert top > 0 and open_top == 0 and open_shadow == pytest.approx(shadow, abs=0.01)
    wall.hide_render = True
    lit, _ = brightness()
    assert lit > 10 * max(shadow, open_shadow)
    with pytest.raises(SceneError, match="no material"), shown_as(bpy.context.scene, [""], plane=(0, 1.5)):
        pass


def test_octree_of_something_else_is_refused(scenes: dict[str, Scene], tmp_path: Path) -> None:
    octree = load_octree(octree_file(scenes["bars-cut"], tmp_path))
    with pytest.raises(SceneError, match="light is 'two-lights'"), as_in_octree(bpy.context, octree, CYCLES):
        pass
    bpy.ops.mesh.primitive_cube_add(size=9.0)
    with pytest.raises(SceneError, match="cube"), as_in_octree(bpy.context, octree, TWO_LIGHTS):
        pass


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "There is nothing to evaluate"),
        (["--scenes", "moon"], "Unknown scene 'moon'"),
        (["--scenes", "courtyard", "--octree", "bars=x.safetensors"], "--scenes does not contain this scene"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert commands.main(["lab", "evaluate-cycles", *words, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
