# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet structures`: kinds and sizes of procedural structures, seeds, files, refusals."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.demo_scene.geometry import Shape
from patchnet.operators.structure_scene import KINDS, compose_structures


def meshes() -> dict[str, np.ndarray]:
    """Vertices (n, 3) of the open scene's meshes, by object."""
    found = {}
    for item in bpy.data.objects:
        if item.type == "MESH":
            points = np.empty(3 * len(item.data.vertices), np.float32)
            item.data.vertices.foreach_get("co", points)
            found[item.name] = points.reshape(-1, 3)
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_shapes_stay_in_their_place_at_all_thicknesses(kind: str) -> None:
    for thick in (0.003, 0.02, 0.1):
        shape: Shape = KINDS[kind](np.random.default_rng(3), thick)
        assert np.isfinite(shape.vertices).all()
        assert np.abs(shape.vertices).max() < 2.0  # leaves reach out farthest
        assert 5 < len(shape.faces) < 200_000
        assert max(max(face) for face in shape.faces) < len(shape.vertices)


def test_every_kind_is_there_and_seeds_decide() -> None:
    assert compose_structures(7) == 72
    first = meshes()
    assert {name.split()[1].split(".")[0] for name in first if name != "Ground"} == {*KINDS, "wall", "letters"}
    assert all(len(points) > 50 for name, points in first.items() if "letters" in name)
    compose_structures(7)
    again = meshes()
    assert first.keys() == again.keys()
    assert all(np.array_equal(first[name], again[name]) for name in first)
    compose_structures(8)
    assert first.keys() != meshes().keys()


def test_command_writes_the_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "structures.glb"
    assert commands.main(["structures", "--seed", "2", "--out", str(out)]) == 0
    assert "72 structures" in capsys.readouterr().out
    assert out.read_bytes()[:4] == b"glTF"
    assert commands.main(["structures", "--out", str(tmp_path / "structures.obj")]) == 2
    assert "let it end with .glb or .blend" in capsys.readouterr().err
