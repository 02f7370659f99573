# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet verify-light`: the octree's light agrees with Cycles, half the light does not."""

import json
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.cycles.camera_render import render_reference
from patchnet.operators.demo_scene import build_room
from patchnet.operators.scene.cameras import choose_cameras
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.verify_light import CheckSettings, LightCheck, check_camera, verify_light
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender.objects import SQUARE, lamp, link, mesh, new_camera, slab
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import image, material, mixed, read_by, shader, shown, simple

LEAST_PSNR_DB = 30.0  # at depth 7, where a voxel is 16 mm
RATIO = 0.04


def settings(**job: object) -> CheckSettings:
    values = {"depth": 7, "size": (48, 48), "max_samples": 8, "cameras": ("Front",)} | job
    return CheckSettings(JobSettings.of(**values), render_samples=256, rays=8)


@pytest.fixture
def room() -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    build_room(bpy.context.scene)
    bpy.context.view_layer.update()


def within_bounds(report: dict) -> bool:
    return report["psnr_db"] >= LEAST_PSNR_DB and abs(report["mean_ratio"] - 1.0) <= RATIO


def test_the_room_agrees_and_half_the_light_does_not(room: None) -> None:
    before = scene_snapshot()
    check: LightCheck = drain(verify_light(bpy.context, settings()))
    assert_unchanged(before)
    (frame,) = check.report["cameras"]
    assert within_bounds(frame), frame
    assert frame["reference_noise_db"] > frame["psnr_db"] + 6.0, "the reference must be cleaner than the difference"
    assert frame["both_hit_share"] == 1.0, "the room is closed"
    json.dumps(check.report, allow_nan=False)
    dark = replace(check.octree.without_sides().without_pieces(), luminance=check.octree.luminance // 2)
    few = replace(settings(), render_samples=32)
    wrong = drain(check_camera(bpy.context, dark, check.cameras[0].camera, few))
    assert wrong.report["mean_ratio"] == pytest.approx(0.5 * frame["mean_ratio"], rel=0.02)
    assert wrong.report["psnr_db"] < LEAST_PSNR_DB
    assert not within_bounds(wrong.report)


def test_uvs_far_beyond_a_cut_out_that_does_not_repeat() -> None:
    """Its border counts, which is opaque; lookups that read all texels on the way would not end."""
    bpy.ops.wm.read_homefile(use_empty=True)
    pixels = np.full((4, 4, 4), 0.5, np.float32)
    pixels[..., 3] = 1.0
    pixels[1:3, 1:3, 3] = 0.0
    hole = image("Hole", pixels)
    hole.pack()
    paint, tree = material("Hole")
    surface = mixed(tree, shader(tree, "BsdfTransparent"), shader(tree, "BsdfDiffuse", Color=(0.5, 0.5, 0.5, 1.0)), 0.5)
    tree.links.new(read_by("TexImage", "Alpha", image=hole, extension="EXTEND")(tree), surface.node.inputs[0])
    shown(tree, surface)
    item = slab("Far", paint)
    uvs = 1e7 * np.random.default_rng(1).uniform(-1.0, 1.0, (len(item.data.loops), 2))
    item.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    lamp("SUN", 3.0, angle=0.15)
    check = drain(verify_light(bpy.context, settings(depth=6, cameras=("auto",))))
    for frame in check.report["cameras"]:
        assert frame["psnr_db"] > 25.0 and abs(frame["mean_ratio"] - 1.0) <= RATIO, frame


def test_reference_is_diffuse_light_and_emission(empty_scene: None) -> None:
    """A mirror shows nothing, a lamp's own shape neither, an emitter its strength; what is not there is not covered."""
    for x, paint in ((-1.0, simple("Emission", Strength=2.0)), (1.0, simple("BsdfGlossy"))):
        link(mesh("Plate", [(a / 2, b / 2, c) for a, b, c in SQUARE], [(0, 1, 2, 3)], paint), (x, 0.0, 0.0))
    lamp("POINT", 50.0, shadow_soft_size=0.2)
    data = new_camera("Above", (-0.2, 0.0, 3.0)).data
    data.type, data.ortho_scale, data.shift_x = "ORTHO", 4.0, 0.05  # the shift brings the picture back
    bpy.context.view_layer.update()
    bounds = np.array([[-2.0, -1.0, 0.0], [2.0, 1.0, 0.0]])
    (camera,) = choose_cameras(bpy.context.evaluated_depsgraph_get(), ("Above",), (40, 20), bounds)
    before = scene_snapshot()
    reference = render_reference(bpy.context, camera, 16, 1)
    assert_unchanged(before)
    emitter, mirror = np.s_[5:15, 5:15], np.s_[5:15, 25:35]
    np.testing.assert_allclose(reference.luminance[emitter], 2.0, rtol=1e-4)
    np.testing.assert_allclose(reference.luminance[mirror], 0.0, atol=1e-6)
    inside = np.zeros((20, 40), bool)
    inside[emitter] = inside[mirror] = True
    np.testing.assert_allclose(reference.coverage, inside, atol=1e-5)
    np.testing.assert_allclose(reference.depth_world[emitter], 3.0, rtol=1e-5)


def test_the_command_fits_an_automatic_depth_to_its_cameras(tmp_path: Path) -> None:
    arguments = ["room", "--depth", "auto", "--cameras", "Front", "--size", "32", "24", "--max-samples", "2"]
    arguments += ["--rays", "2", "--render-samples", "2", "--out", str(tmp_path / "check")]
    assert commands.main(["verify-light", *arguments]) == 0
    report = json.loads((tmp_path / "check" / "report.json").read_text())
    assert report["light"]["fitted"] and report["octree"]["depth"] >= 8


def test_the_command_writes_pictures_and_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "check"
    arguments = ["room", "--depth", "5", "--cameras", "2", "--size", "32", "24", "--max-samples", "4", "--rays", "4"]
    arguments += ["--render-samples", "8", "--out", str(out)]
    assert commands.main(["verify-light", *arguments]) == 0
    printed = capsys.readouterr().out
    assert "View 1" in printed and "PSNR" in printed
    report = json.loads((out / "report.json").read_text())
    assert [frame["camera"] for frame in report["cameras"]] == ["View 1", "View 2"]
    for frame in report["cameras"]:
        x, y, z = frame["position_world"]
        assert max(abs(x), abs(y)) < 1.0 and 0.0 < z < 2.0, "in the room"
        names = {path.name for path in (out / frame["folder"]).iterdir()}
        assert names == {"cycles.png", "octree.png", "difference.png", "side_by_side.png"}
        assert f"{frame['psnr_db']:.2f}" in printed
