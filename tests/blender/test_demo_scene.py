# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene: same seed, same scene; what has to be in it; how far its cameras stand."""

import hashlib
from dataclasses import dataclass

import bpy
import numpy as np
import pytest

from patchnet.operators.demo_scene import build_courtyard, save_demo_scene
from patchnet.operators.demo_scene.geometry import Shape, projected_uv
from patchnet.patchnet_addon.surface.connected import sheets_of


@dataclass
class Placed:
    """Content of the evaluated scene: vertices (n, 3) of all placed objects, and counts."""

    vertices: np.ndarray
    triangles: int
    area: float
    instances: int

    @property
    def extent(self) -> float:
        return float(np.ptp(self.vertices, axis=0).max())


def measure() -> Placed:
    vertices, triangles, area, instances = [], 0, 0.0, 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        item = instance.object
        if item.type not in ("MESH", "CURVE", "FONT"):
            continue
        mesh = item.to_mesh()
        mesh.calc_loop_triangles()
        matrix = np.array(instance.matrix_world)
        local = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", local)
        world = local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        a, b, c = world[corners.reshape(-1, 3)].transpose(1, 0, 2)
        vertices.append(world)
        triangles += len(a)
        area += float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
        instances += instance.is_instance and len(a) > 0
        item.to_mesh_clear()
    return Placed(np.concatenate(vertices), triangles, area, instances)


def pictures() -> str:
    """A digest of all images' pixels."""
    digest = hashlib.sha256()
    for image in sorted(bpy.data.images, key=lambda image: image.name):
        values = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(values)
        digest.update(image.name.encode() + np.round(values * 255).astype(np.uint8).tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Placed, Placed]:
    """The scene as built and left open, and as another build with the same seed, saved and read back."""
    path = tmp_path_factory.mktemp("demo") / "folder" / "courtyard.blend"
    save_demo_scene(path, seed=3)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    saved = measure(), pictures()
    bpy.ops.wm.read_homefile(use_empty=True)
    build_courtyard(bpy.context.scene, seed=3)
    bpy.context.view_layer.update()
    assert saved[1] == pictures()
    return measure(), saved[0]


def test_same_seed_gives_the_same_scene(built: tuple[Placed, Placed]) -> None:
    first, second = built
    assert (first.triangles, first.instances) == (second.triangles, second.instances)
    np.testing.assert_array_equal(first.vertices.sum(axis=0), second.vertices.sum(axis=0))


def test_size(built: tuple[Placed, Placed]) -> None:
    placed = built[0]
    assert np.isfinite(placed.vertices).all()
    assert 200_000 <= placed.triangles <= 600_000
    assert 11.0 < placed.extent < 16.0
    assert placed.area < 8.0 * placed.extent**2  # leaf cards count whole here, and are half empty


@pytest.mark.usefixtures("built")
def test_normals_of_closed_things_point_outwards() -> None:
    inwards, closed = set(), 0
    for mesh in bpy.data.meshes:
        mesh.calc_loop_triangles()
        corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        places = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", places)
        triangles, vertices = corners.reshape(-1, 3), places.reshape(-1, 3)
        sheet, is_open = sheets_of(vertices, triangles)
        a, b, c = vertices[triangles].astype(np.float64).transpose(1, 0, 2)
        volume = np.bincount(sheet[sheet >= 0], np.einsum("tc,tc->t", a, np.cross(b, c))[sheet >= 0], len(is_open))
        closed += np.count_nonzero(~is_open)
        if (volume[~is_open] < 0).any():
            inwards.add(mesh.name)
    assert closed > 100 and inwards == set()


def test_cloth_lies_closely_on_the_table(built: tuple[Placed, Placed]) -> None:
    objects = bpy.context.scene.objects
    cloth, table = objects["Table cloth"], objects["Table top"]
    lowest = min((cloth.matrix_world @ vertex.co).z for vertex in cloth.data.vertices)
    highest = max((cloth.matrix_world @ vertex.co).z for vertex in cloth.data.vertices)
    top = max((table.matrix_world @ vertex.co).z for vertex in table.data.vertices)
    assert 0.003 < highest - top < 0.012
    assert lowest < top - 0.2


@pytest.mark.parametrize("name, nearest", [("Far", 0.9), ("Middle", 0.5)])
def test_cameras_keep_their_distance(built: tuple[Placed, Placed], name: str, nearest: float) -> None:
    """Everything within the picture lies farther away than look-ahead needs at 192 pixels."""
    camera = bpy.context.scene.objects[name]
    assert camera.data.angle == pytest.approx(np.radians(50.0), abs=1e-5)
    view = np.array(camera.matrix_world.inverted())
    x, y, z = (built[0].vertices @ view[:3, :3].T + view[:3, 3]).T * np.array([[1], [1], [-1]])
    half = np.tan(camera.data.angle / 2) * z
    seen = (z > 0) & (np.abs(x) < half) & (np.abs(y) < half)
    assert seen.mean() > 0.7
    assert z[seen].min() > nearest * built[0].extent


@pytest.mark.parametrize("noise", [-1e-13, 1e-13])
def test_coordinates_of_oblique_faces_do_not_depend_on_rounding(noise: float) -> None:
    """An eight-sided basin has faces at 45 degrees, whose larger coordinate is a matter of the last bit."""
    wall = np.array([[0.0, 1.0, 0.0], [1.0 + noise, 0.0, 0.0], [1.0 + noise, 0.0, 1.0], [0.0, 1.0, 1.0]])
    uv = projected_uv(Shape(wall, [(0, 1, 2, 3)]), 1.0)
    assert np.allclose(uv, [[1, 0], [0, 0], [0, 1], [1, 1]], atol=1e-9)
