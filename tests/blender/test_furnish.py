# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab furnish` with a small library: sizes, seeds, files, refusals."""

from itertools import combinations
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.tests.blender.objects import CUBE_FACES, corners, mesh
from patchnet.tests.furniture_library import write_library
from patchnet.training import commands
from patchnet.training.commands.lab.furnished.compose import compose_scene
from patchnet.training.commands.lab.furnished.library import read_library
from patchnet.training.commands.lab.furnished.models import library_meshes, repair_mesh, vertices_of

CREDITS = "scene.credits.txt"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_library(tmp_path / "cubes.sh3f", extra="modelRotation#1=0 0 1 0 1 0 -1 0 0")


def placed() -> dict[str, np.ndarray]:
    """Vertices (n, 3) in world space of what stands in the scene, by name."""
    bpy.context.view_layer.update()
    found = {}
    for item in bpy.data.collections["Furniture"].objects:
        matrix = np.array(item.matrix_world)
        found[item.name] = vertices_of(item.data) @ matrix[:3, :3].T + matrix[:3, 3]
    return found


@pytest.mark.parametrize("kind", ["interior", "garden"])
def test_nothing_intersects_and_sizes_are_true(path: Path, kind: str) -> None:
    library = read_library(path)
    composed = compose_scene([library], kind, 2)
    things = {name: points for name, points in placed().items() if "Stool" not in name}
    assert len(things) == len(composed.plan.placements) > 10
    for placement, points in zip(composed.plan.placements, things.values(), strict=True):
        box = placement.box()
        assert (points.min(axis=0) > np.array(box.low) - 1e-4).all()
        assert (points.max(axis=0) < np.array(box.high) + 1e-4).all()
        assert np.ptp(points[:, 2]) == pytest.approx(placement.piece.size[2], abs=1e-4)
    boxes = [(points.min(axis=0) + 1e-4, points.max(axis=0) - 1e-4) for points in things.values()]
    assert not [1 for a, b in combinations(boxes, 2) if (a[0] < b[1]).all() and (b[0] < a[1]).all()]


def test_model_is_turned_before_it_is_scaled(path: Path) -> None:
    table, chair = read_library(path).pieces[:2]
    for piece, model in library_meshes([table, chair]).items():
        points = vertices_of(model)
        assert np.allclose(np.ptp(points, axis=0), piece.size, atol=1e-5)
        assert np.allclose(points.min(axis=0), (-piece.size[0] / 2, -piece.size[1] / 2, 0.0), atol=1e-5)
    # The model's lower edge of z = 0 (its back) is at +y; turned by a quarter, what was on its right is.
    assert np.allclose(vertices_of(library_meshes([chair])[chair])[0], (-0.225, 0.25, 0.0), atol=1e-5)
    assert np.allclose(vertices_of(library_meshes([table])[table])[0][:2], (-0.75, -0.4), atol=1e-5)


def test_faces_that_lie_on_others_go_and_the_rest_faces_outwards(empty_scene: None) -> None:
    mixed = [face[::-1] if number % 2 else face for number, face in enumerate(CUBE_FACES)]
    cube = mesh("Cube", corners((0, 0, 0), (1, 1, 1)), mixed + [face[::-1] for face in mixed]).data
    repair_mesh(cube)
    middle = np.array([0.5, 0.5, 0.5])
    outward = [np.dot(polygon.normal, np.array(polygon.center) - middle) for polygon in cube.polygons]
    assert len(outward) == 6 and min(outward) > 0.4


def test_command(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "made" / "scene.glb"
    words = ["lab", "furnish", str(path), "--seed", "3", "--out", str(out)]
    assert commands.main(words) == 0
    assert f"{out}: " in capsys.readouterr().out
    assert {file.name for file in out.parent.iterdir()} == {out.name, CREDITS}
    text = (out.parent / CREDITS).read_text()
    assert "patchnet lab furnish cubes.sh3f --kind interior --seed 3" in text and "| Sofa | A / tester |" in text
    assert commands.main(words) == 0  # its own files are replaced
    from patchnet.operators.scene.files import open_scene

    open_scene(out)
    assert {item.type for item in bpy.data.objects} == {"MESH"}
    assert all(image.packed_file for image in bpy.data.images if image.source == "FILE")
    floor = bpy.data.objects["Floor"]
    assert floor.dimensions.z == pytest.approx(0.16, abs=1e-3) and floor.dimensions.x > 5.0


@pytest.mark.parametrize(
    ("name", "out", "why"),
    [
        ("cubes.sh3f", "scene.fbx", "use the ending .glb"),
        ("cubes.sh3f", "other.glb", "is not a .glb file"),
        ("none.sh3f", "scene.glb", "is no file"),
        ("KatorLegaz.sh3f", "scene.glb", "kept for the tests of others"),
    ],
)
def test_refusals(
    path: Path, tmp_path: Path, name: str, out: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other.glb").write_text("foreign")
    assert commands.main(["lab", "furnish", str(tmp_path / name), "--out", str(tmp_path / out)]) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / CREDITS).exists()
