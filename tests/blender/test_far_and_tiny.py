# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes far from the origin, tiny and huge: the same picture, or an error that names the object."""

import warnings
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from patchnet.operators.pipeline.run import JobResult
from patchnet.patchnet_addon.runtime.errors import GeometryError
from patchnet.tests.blender.job_scene import build, ran


def placed(offset: float = 0.0, scale: float = 1.0) -> None:
    """The small scene, scaled about the origin and moved along x, with its camera."""
    build()
    for item in bpy.context.scene.objects:
        turn = item.matrix_world.to_3x3().to_4x4()
        at = Matrix.Translation(scale * item.matrix_world.translation + Matrix.Translation((offset, 0, 0)).translation)
        item.matrix_world = at @ turn @ (Matrix.Scale(scale, 4) if item.type == "MESH" else Matrix())
        if item.type == "CAMERA":
            item.data.clip_start, item.data.clip_end = max(1e-6, 1e-3 * scale), 1e3 * max(scale, 1.0)
    bpy.context.view_layer.update()


def look(weights: Path, light: str = "two-lights") -> JobResult:
    small = {"depth": 5, "max_samples": 2, "size": (24, 16), "strategy": "patchnet", "reference": True}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # of NumPy
        return ran(light=light, weights=weights, **small)


@pytest.fixture(scope="module")
def at_home(tmp_path_factory: pytest.TempPathFactory, weights: Path) -> np.ndarray:
    placed()
    picture = look(weights).views[0].pictures["reference"]
    assert picture.max() > 0.3
    return picture


@pytest.mark.parametrize(
    ("offset", "scale"), [(1e4, 1.0), (0.0, 1e-6), (1e9, 1e9)], ids=["far", "tiny", "huge and far"]
)
def test_same_picture_as_at_home(offset: float, scale: float, at_home: np.ndarray, weights: Path) -> None:
    """Within what single precision does to the camera's place: some rays pass an edge on its other side."""
    placed(offset, scale)
    result = look(weights)
    assert np.abs(result.views[0].pictures["reference"] - at_home).mean() < 0.01
    assert not [text for text in result.warnings if "origin" in text]


def test_far_from_the_origin_nothing_is_left_of_it(weights: Path) -> None:
    placed(1e9)
    with pytest.raises(GeometryError, match=r"Object '(Slab|Lath \d)' is 1e\+09 units from the origin, where coord"):
        look(weights)


@pytest.mark.parametrize(
    ("offset", "scale", "said"),
    [
        (1e6, 1.0, r"'(Slab|Lath \d)' is 1e\+06 units from the origin, where Cycles samples light 3.8 off"),
        (0.0, 1e-9, r"'(Slab|Lath \d)' is 2e-09 units across; Cycles computes wrong light below 1e-07: scale"),
        (0.0, 1e11, r"'(Slab|Lath \d)' extends 1e\+11 units from the origin; Cycles computes wrong light beyond"),
    ],
    ids=["far", "tiny", "huge"],
)
def test_light_that_would_be_wrong_is_refused(offset: float, scale: float, said: str, weights: Path) -> None:
    placed(offset, scale)
    with pytest.raises(GeometryError, match=said):
        look(weights, "cycles")


def test_what_is_coarser_than_a_voxel_is_said(weights: Path) -> None:
    placed(1.5e6)
    (warning,) = [text for text in look(weights).warnings if "origin" in text]
    assert "rounded to 0.12, more than a voxel (0.063)" in warning and "to the origin" in warning


def test_vertices_that_no_number_can_place_name_their_object(weights: Path) -> None:
    build()
    bpy.data.objects["Lath 2"].data.vertices[3].co.y = 3e38
    bpy.data.objects["Lath 2"].scale = (1.0, 1e9, 1.0)
    bpy.context.view_layer.update()
    with pytest.raises(GeometryError, match="Object 'Lath 2'"):
        look(weights)


def test_an_object_far_from_all_others_is_named(weights: Path) -> None:
    build()
    bpy.data.objects["Lath 3"].location.x = 1e9
    bpy.context.view_layer.update()
    first, second = look(weights).warnings
    assert first.startswith("Object 'Lath 3' is 1e+09 units from all other objects, so voxels of 3.1e+07 are too large")
    assert second.startswith("Camera 'Eye' sees nothing but the voxel of side")
