# SPDX-License-Identifier: GPL-3.0-or-later
"""Open scene files of every kind, damaged files and files of other kinds."""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.commands.shared.scene_argument import scene_path
from patchnet.operators.scene.files import is_blend, open_scene
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.tests.blender.objects import link, mesh, new_camera, read


@pytest.fixture
def triangle() -> bpy.types.Object:
    bpy.ops.wm.read_homefile(use_empty=True)
    item = link(mesh("Triangle", [(0, 0, 0), (2, 0, 0), (0, 3, 0)], [(0, 1, 2)]))
    item.select_set(True)
    bpy.context.view_layer.objects.active = item
    new_camera("Eye")
    return item


@pytest.mark.parametrize("extension", ["blend", "gltf", "obj", "ply", "stl", "fbx", "GLB"])
def test_files_are_read(triangle: bpy.types.Object, tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"a scene.{extension}"
    if extension == "blend":
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
    elif extension.lower() in ("glb", "gltf"):
        kind = "GLB" if extension.lower() == "glb" else "GLTF_SEPARATE"
        bpy.ops.export_scene.gltf(filepath=str(path), export_format=kind)
        if not path.exists():
            path.with_suffix(f".{extension.lower()}").rename(path)
    elif extension == "fbx":
        bpy.ops.export_scene.fbx(filepath=str(path))
    else:
        getattr(bpy.ops.wm, f"{extension}_export")(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    open_scene(path)
    source = read()
    assert source.triangle_count == 1
    (batch,) = source.batches()
    a, b, c = batch.corners_world[0]
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a)) == pytest.approx(3.0, rel=1e-4)


def test_missing_unknown_and_damaged_files(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="does not exist"):
        open_scene(tmp_path / "nothing.glb")
    with pytest.raises(SceneError, match=r"is a folder: name a file in it$"):
        open_scene(tmp_path)
    (tmp_path / "scene.doc").write_text("text")
    with pytest.raises(SceneError, match=r"unknown extension '\.doc'"):
        open_scene(tmp_path / "scene.doc")
    for extension in ("blend", "glb", "gltf", "obj", "ply", "stl", "fbx"):
        path = tmp_path / f"damaged.{extension}"
        path.write_bytes(b"this is no scene at all \x00\x01\x02" * 10)
        with pytest.raises(SceneError, match=f"damaged.{extension}"):
            open_scene(path)


def test_operators_name_the_file_that_could_not_be_opened(registered: None, tmp_path: Path) -> None:
    """As `blender -b damaged.blend` leaves them: with a scene of nobody's."""
    path = tmp_path / "damaged.blend"
    path.write_bytes(b"BLENDER-v405" + b"this is no scene " * 50)
    bpy.ops.wm.read_homefile(use_empty=True)
    with pytest.raises(RuntimeError, match="damaged"):
        bpy.ops.wm.open_mainfile(filepath=str(path))
    for arguments in ({}, {"out": "//out"}):
        with pytest.raises(RuntimeError, match=r"damaged\.blend could not be opened and may be damaged"):
            bpy.ops.patchnet.run_all(**arguments)
    with pytest.raises(SceneError, match=r"damaged\.blend could not be opened"):
        scene_path(None)
    bpy.ops.wm.read_homefile(use_empty=True)  # whatever is opened next is there to work on
    with pytest.raises(RuntimeError, match=r"has no camera|No visible object"):
        bpy.ops.patchnet.run_all()


_OPEN = """
import sys
from patchnet.operators.scene.files import open_scene
from patchnet.patchnet_addon.runtime.errors import SceneError
for path in sys.argv[1:]:
    try:
        open_scene(path)
    except SceneError as error:
        print(error)
"""


def test_an_importer_that_fails_prints_nothing_and_its_reason_is_told(tmp_path: Path) -> None:
    """Reports of its own, an exception in its code, and what compiled code prints to stderr alone."""
    scene = '{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 7}]%s}'
    files = {
        "required.gltf": (scene % ', "extensionsUsed": ["FOO_bar"], "extensionsRequired": ["FOO_bar"]', "FOO_bar"),
        "exception.gltf": (scene % "", "(TypeError: object of type 'NoneType' has no len())"),
        "compiled.abc": ("this is no scene", "unknown file format"),
    }
    for name, (text, _) in files.items():
        (tmp_path / name).write_text(text)
    words = [sys.executable, "-c", _OPEN, *(str(tmp_path / name) for name in files)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    said = [line for line in done.stdout.splitlines() if "color_management" not in line]  # Blender 5.3 starts so
    for line, (name, (_, reason)) in zip(said, files.items(), strict=True):
        assert line.startswith(f"Scene file {tmp_path / name} cannot be read and may be damaged (") and reason in line


@pytest.mark.parametrize("extension", [".blend1", ".BLEND32"])
def test_backups_of_blender_are_opened(triangle: bpy.types.Object, tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"scene{extension}"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    (tmp_path / "scene.blend").rename(path)
    bpy.ops.wm.read_homefile(use_empty=True)
    open_scene(path)
    assert "Triangle" in bpy.data.objects and bpy.data.filepath == str(path)
    assert not is_blend(Path("scene.blend33"))
