# SPDX-License-Identifier: GPL-3.0-or-later
"""Export Voxels, read by Blender's own importers where there is one."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.session import results
from patchnet.patchnet_addon.export.fine_light import FINE_LIGHT, LIGHT_NOISE, WANTED_NOISE, fine_light_text
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.octree.voxel_cloud import VoxelCloud, voxel_cloud
from patchnet.tests.blender.job_scene import build
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.training.commands.lab.furnished.models import vertices_of


@pytest.fixture(autouse=True)
def scene(scene: bpy.types.Scene) -> bpy.types.Scene:
    bpy.ops.patchnet.voxelize(depth=6)
    return scene


def cloud(level: int) -> VoxelCloud:
    return voxel_cloud(results.voxels_of(bpy.context.scene).octree, level)


@pytest.mark.parametrize("ending", [".ply", ".safetensors"])
def test_every_format_leaves_the_scene_alone(ending: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path, before = tmp_path / f"voxels{ending}", scene_snapshot()
    assert bpy.ops.patchnet.export_octree(filepath=str(path), level=4) == {"FINISHED"}
    assert path.stat().st_size > 1000 and [each.name for each in tmp_path.iterdir()] == [path.name]
    assert f"{len(cloud(4)):,} voxels of level 4" in capfd.readouterr().out
    assert_unchanged(before)
    assert results.voxels_of(bpy.context.scene).stale == set()


def test_level_of_the_panel_and_the_finest(scene: bpy.types.Scene, tmp_path: Path) -> None:
    path = tmp_path / "octree.safetensors"
    bpy.ops.patchnet.export_octree(filepath=str(path))
    assert load_octree(path).depth == 6
    scene.patchnet.level = 3
    bpy.ops.patchnet.export_octree(filepath=str(path))
    assert load_octree(path).depth == 3


def test_ply_in_blender(tmp_path: Path) -> None:
    path = tmp_path / "voxels.ply"
    bpy.ops.patchnet.export_octree(filepath=str(path), level=5)
    bpy.ops.wm.ply_import(filepath=str(path), forward_axis="Y", up_axis="Z")
    mesh, voxels = bpy.context.object.data, cloud(5)
    np.testing.assert_allclose(vertices_of(mesh), voxels.centres_world, atol=1e-6)
    for name, expected in (("scalar_luminance", voxels.luminance), ("scalar_side", voxels.side_world)):
        values = np.empty(len(mesh.vertices), np.float32)
        mesh.attributes[name].data.foreach_get("value", values)
        np.testing.assert_array_equal(values, expected)
    colors = np.empty((len(mesh.vertices), 4), np.float32)
    mesh.color_attributes.active_color.data.foreach_get("color", colors.ravel())
    np.testing.assert_allclose(colors[:, 0], voxels.luminance, atol=0.005)


def test_bad_input_is_one_sentence(tmp_path: Path) -> None:
    for keywords, message in (
        ({"filepath": str(tmp_path / "voxels.obj")}, "choose one of .ply"),
        ({"filepath": str(tmp_path / "voxels.ply"), "level": 7}, "Level 7 is outside 0 to 6"),
        ({"filepath": str(tmp_path / "nowhere" / "voxels.ply")}, "does not exist"),
        ({"filepath": "//voxels.ply"}, "save the file first"),
        ({}, "No file to write"),
    ):
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.patchnet.export_octree(**keywords)
    assert not list(tmp_path.iterdir())
    build()
    with pytest.raises(RuntimeError, match="no voxels yet"):
        bpy.ops.patchnet.export_octree(filepath=str(tmp_path / "voxels.ply"))


def test_noise_above_the_threshold_is_said() -> None:
    octree = results.voxels_of(bpy.context.scene).octree
    octree.provenance.update({FINE_LIGHT: 1.0, LIGHT_NOISE: 0.026, WANTED_NOISE: 0.01})
    assert fine_light_text(octree) == "Fine light everywhere; noise 2.6%, above 1%: raise Max Samples"


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (None, ""),
        (1.0, "Fine light everywhere; noise 0.8%"),
        (0.25, "Fine light on 25% of the voxels, those that cameras see; noise 0.8%"),
        (0.9999, "Fine light on 99% of the voxels, those that cameras see; noise 0.8%"),
    ],
)
def test_files_say_where_light_is_fine(
    share: float | None, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    octree = results.voxels_of(bpy.context.scene).octree
    assert fine_light_text(octree) == "", "it is not baked"
    octree.provenance.update({} if share is None else {FINE_LIGHT: share, LIGHT_NOISE: 0.008})
    assert fine_light_text(octree) == words
    ply, file = (tmp_path / f"voxels{ending}" for ending in (".ply", ".safetensors"))
    bpy.ops.patchnet.export_octree(filepath=str(ply), level=4)
    header = ply.read_bytes().split(b"end_header")[0].decode("ascii").splitlines()
    assert [line for line in header if "light" in line] == ([f"comment {words}"] if words else [])
    save_octree(octree, file)
    capsys.readouterr()
    assert commands.main(["info", str(file)]) == 0
    said = [line.strip() for line in capsys.readouterr().out.splitlines() if "fine light" in line]
    assert said == ([words.lower()] if words else [])
