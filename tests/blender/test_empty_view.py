# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons for empty and black pictures in operators, commands and the render engine."""

import logging
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.patchnet_addon.tracing.empty_view import BLACK_VIEWS
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.blender.engine_scene import build_for_engine, rendered
from patchnet.tests.blender.job_scene import build, principled, ran, render_by_cycles, saved
from patchnet.tests.blender.light_scene import lit
from patchnet.tests.blender.objects import SQUARE, active_camera, lamp, link, look_from, mesh
from patchnet.tests.blender.shaders import glowing, grey, material, read_by, simple

BEHIND = "Camera 'Eye' sees nothing: the surface is behind it; turn or move it"
SMALL = {"depth": 4, "max_samples": 2, "size": (24, 16), "cameras": ("Eye",), "gloss": "off"}


def turn_away() -> None:
    bpy.data.objects["Eye"].rotation_euler = (-1.5, 0.0, 0.0)


def said(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]


@pytest.fixture
def heard(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.WARNING, "patchnet")
    return caplog


def test_operators_say_why_nothing_is_seen(scene: bpy.types.Scene, heard: pytest.LogCaptureFixture) -> None:
    turn_away()
    small = {"depth": 5, "size": (24, 16), "light": "two-lights"}
    assert bpy.ops.patchnet.run_all(**small) == {"FINISHED"}
    assert BEHIND in said(heard)
    for operator in (bpy.ops.patchnet.render_preview, bpy.ops.patchnet.compare):
        heard.clear()
        assert operator(size=(24, 16)) == {"FINISHED"}
        assert BEHIND in said(heard)
    heard.clear()
    bpy.data.objects["Eye"].rotation_euler = (1.5, 0.0, 0.05)
    assert bpy.ops.patchnet.render_preview(size=(24, 16)) == {"FINISHED"}
    assert not said(heard)


def test_render_engine_says_it(
    registered: None, weights: Path, tmp_path: Path, heard: pytest.LogCaptureFixture
) -> None:
    scene = build_for_engine(weights, tmp_path)
    turn_away()
    assert (rendered(scene)["Level"] == -1).all()
    assert BEHIND in said(heard)


def test_black_materials_are_named_as_the_reason(weights: Path) -> None:
    build()
    for paint in bpy.data.materials:
        principled(paint.name).inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    settings = {"depth": 5, "light": "two-lights", "size": (24, 16), "strategy": "patchnet-behind"}
    assert ran(weights=weights, **settings).warnings == (
        "Camera 'Eye' sees only black: all materials of the surface are black: 'Slab', 'Lath 0', 'Lath 1', "
        "'Lath 2', 'Lath 3' and 1 more",
    )


def test_lamp_that_reaches_nothing_is_named_as_the_reason(weights: Path) -> None:
    build()
    lamp = bpy.data.objects["Lamp"]
    lamp.data.type, lamp.data.energy = "SPOT", 10.0
    lamp.location, lamp.rotation_euler = (0.0, 0.0, 50.0), (np.pi, 0.0, 0.0)  # into the sky
    bpy.context.view_layer.update()
    settings = {"depth": 5, "max_samples": 2, "size": (24, 16), "strategy": "patchnet-behind"}
    (warning,) = ran(weights=weights, **settings).warnings
    assert warning.startswith("Camera 'Eye' sees only black: no light of the scene reaches 'Slab'")


def plate(make: Callable[[], bpy.types.Material], below: bool) -> None:
    """A plate that fills the view of a camera above it, with a sun above or below."""
    bpy.ops.wm.read_homefile(use_empty=True)
    link(mesh("Plate", SQUARE, [(0, 1, 2, 3)], make()))
    lamp("SUN", 3.0).rotation_euler.x = np.pi if below else 0.0
    look_from((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    bpy.context.view_layer.update()


def no_output() -> bpy.types.Material:
    paint, tree = material("Coal")
    tree.nodes.clear()
    return paint


def missing_attribute() -> bpy.types.Material:
    return glowing(read_by("Attribute", attribute_name="paint", attribute_type="OBJECT"), "Coal")


BLACK = {
    "black": (lambda: simple(name="Coal", Color=(0, 0, 0, 1)), False, "the material 'Coal' of 'Plate' is black; give"),
    "no output": (no_output, False, "Coal' of 'Plate' is black: Material 'Coal' is black, as in Cycles: no Material"),
    "metal": (
        lambda: simple("BsdfGlossy", "Coal", Roughness=0.4), False,
        "the material 'Coal' of 'Plate' is black without its gloss; choose Gloss",
    ),
    "attribute": (missing_attribute, False, "material 'Coal' of 'Plate' is black"),
    "other side": (grey, True, "light falls on the other side of 'Plate' alone"),
}  # fmt: skip


@pytest.mark.parametrize("case", BLACK)
def test_reason_of_a_black_picture_names_object_and_material(case: str) -> None:
    make, below, said = BLACK[case]
    plate(make, below)
    made = lit(**SMALL)
    assert said in made.octree.provenance[BLACK_VIEWS]["Eye"]


def test_a_back_without_light_is_black_though_nothing_else_has_a_lit_back() -> None:
    plate(grey, below=True)
    bpy.data.objects["Plate"].data.flip_normals()
    made = lit(**SMALL)
    assert "light falls on the other side of 'Plate' alone" in made.octree.provenance[BLACK_VIEWS]["Eye"]
    hits = first_hits(made.octree, active_camera(SMALL["size"]))
    assert hits.hit.any() and hits.luminance[hits.hit].max() < 0.02


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_clipping_is_that_of_cycles(kind: str, weights: Path, tmp_path: Path) -> None:
    """The slab stands behind the laths: each is gone where Cycles' own render has it gone, to a voxel's accuracy."""
    build()
    eye = bpy.data.objects["Eye"]
    eye.location, eye.rotation_euler = (0.0, -5.0, 0.0), (np.pi / 2, 0.0, 0.0)
    eye.data.type, eye.data.ortho_scale = kind, 3.0
    for clip, seen in (((4.8, 100.0), "slab"), ((0.1, 5.0), "laths"), ((0.1, 100.0), "both")):
        eye.data.clip_start, eye.data.clip_end = clip
        bpy.context.view_layer.update()
        result = ran(depth=6, light="two-lights", size=(24, 16), weights=weights, strategy="patchnet")
        hits = result.views[0].buffers.hits
        depth = hits.z_world[hits.hit]
        assert ((depth > 5.2).any(), (depth < 4.8).any()) == {
            "slab": (True, False), "laths": (False, True), "both": (True, True)
        }[seen]  # fmt: skip
        assert not result.warnings
        cycles = render_by_cycles(tmp_path / "cycles.exr", (24, 16), 4)[..., 3]
        if seen == "slab":
            assert (hits.hit.reshape(16, 24) == (cycles > 0.5)).mean() > 0.95
        assert (cycles.mean() > 0.25) == (seen != "laths")  # which are thin


def test_octree_that_is_fitted_to_nothing_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    build()
    path, out = saved(tmp_path / "small.blend"), tmp_path / "fitted.safetensors"
    words = ["octree", str(path), "--depth", "auto", "--light", "two-lights", "--size", "24", "16", "--out", str(out)]
    assert commands.main([*words, "--view", "0", "-5", "0", "0", "-9", "0"]) == 0
    assert "Note: Camera 'View 1' sees nothing: the surface is behind it" in capsys.readouterr().err
