# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene: reproducible by seed, outward normals; added to a user's file as a scene of its own."""

import hashlib

import bpy
import numpy as np
import pytest

from patchnet.operators.add_demo_scene import NAME
from patchnet.operators.demo_scene import build_courtyard, save_demo_scene
from patchnet.operators.demo_scene.geometry import Shape, projected_uv
from patchnet.operators.jobs.job_operator import JobInWindow
from patchnet.patchnet_addon.light.sheets import sheets_of
from patchnet.tests.blender.job_scene import pixels_of
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.training.commands.lab.furnished.models import vertices_of


def placed() -> np.ndarray:
    """Vertices (n, 3) in world space of all placed objects of the evaluated scene."""
    found = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type in ("MESH", "CURVE", "FONT"):
            mesh, matrix = instance.object.to_mesh(), np.array(instance.matrix_world)
            found.append(vertices_of(mesh) @ matrix[:3, :3].T + matrix[:3, 3])
            instance.object.to_mesh_clear()
    return np.concatenate(found)


def pictures() -> str:
    """A digest of all images' pixels."""
    digest = hashlib.sha256()
    for image in sorted(bpy.data.images, key=lambda image: image.name):
        digest.update(image.name.encode() + np.round(pixels_of(image) * 255).astype(np.uint8).tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, np.ndarray]:
    """The scene as built and left open, and as another build with the same seed, saved and read back."""
    path = tmp_path_factory.mktemp("demo") / "folder" / "courtyard.blend"
    save_demo_scene(path, seed=3)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    saved = placed(), pictures()
    bpy.ops.wm.read_homefile(use_empty=True)
    build_courtyard(bpy.context.scene, seed=3)
    bpy.context.view_layer.update()
    assert saved[1] == pictures()
    return placed(), saved[0]


def test_same_seed_gives_the_same_scene(built: tuple[np.ndarray, np.ndarray]) -> None:
    first, second = built
    assert len(first) == len(second)
    np.testing.assert_array_equal(first.sum(axis=0), second.sum(axis=0))


@pytest.mark.usefixtures("built")
def test_normals_of_closed_things_point_outwards() -> None:
    inwards, closed = set(), 0
    for mesh in bpy.data.meshes:
        mesh.calc_loop_triangles()
        corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        triangles, vertices = corners.reshape(-1, 3), vertices_of(mesh)
        sheet, is_open = sheets_of(vertices, triangles)
        a, b, c = vertices[triangles].transpose(1, 0, 2)
        volume = np.bincount(sheet[sheet >= 0], np.einsum("tc,tc->t", a, np.cross(b, c))[sheet >= 0], len(is_open))
        closed += np.count_nonzero(~is_open)
        if (volume[~is_open] < 0).any():
            inwards.add(mesh.name)
    assert closed > 100 and inwards == set()


@pytest.mark.parametrize("noise", [-1e-13, 1e-13])
def test_coordinates_of_oblique_faces_do_not_depend_on_rounding(noise: float) -> None:
    """An eight-sided basin has faces at 45 degrees, whose larger coordinate is a matter of the last bit."""
    wall = np.array([[0.0, 1.0, 0.0], [1.0 + noise, 0.0, 0.0], [1.0 + noise, 0.0, 1.0], [0.0, 1.0, 1.0]])
    uv = projected_uv(Shape(wall, [(0, 1, 2, 3)]), 1.0)
    assert np.allclose(uv, [[1, 0], [0, 0], [0, 1], [1, 1]], atol=1e-9)


@pytest.mark.usefixtures("scene")
def test_a_scene_of_its_own_is_shown_and_selected() -> None:
    mine = bpy.context.scene
    before = scene_snapshot()
    assert bpy.ops.patchnet.add_demo_scene() == {"FINISHED"}
    shown = bpy.context.window.scene
    assert shown.name == NAME and shown.camera.name == "Middle" and shown.world is not None
    assert len(shown.objects) > 50
    assert {item for item in shown.view_layers[0].objects if item.select_get()} == set(shown.view_layers[0].objects)
    assert not set(shown.objects) & set(mine.objects)
    views = [area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D"]
    assert "CAMERA" in [area.spaces.active.region_3d.view_perspective for area in views]
    bpy.context.window.scene = mine
    bpy.data.scenes.remove(shown)
    bpy.data.orphans_purge(do_recursive=True)
    assert_unchanged(before)


@pytest.mark.usefixtures("scene")
def test_undo_removes_it() -> None:
    bpy.ops.ed.undo_push(message="before")
    names = {item.name for item in bpy.data.objects}
    bpy.ops.patchnet.add_demo_scene()
    bpy.ops.ed.undo_push(message="added")  # as Blender does after an operator in a window
    bpy.ops.ed.undo()
    assert NAME not in bpy.data.scenes and {item.name for item in bpy.data.objects} == names
    bpy.ops.ed.redo()
    assert len(bpy.data.scenes[NAME].objects) > 50


@pytest.mark.usefixtures("scene")
def test_it_waits_for_jobs_and_for_object_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(JobInWindow, "title", "Bake Light")
    with pytest.raises(RuntimeError, match="Bake Light is running"):
        bpy.ops.patchnet.add_demo_scene()
    monkeypatch.undo()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode only"):
        bpy.ops.patchnet.add_demo_scene()
    bpy.ops.object.mode_set(mode="OBJECT")
