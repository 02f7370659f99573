# SPDX-License-Identifier: GPL-3.0-or-later
"""Warnings of materials that a bake cannot show like a render, and none of others."""

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles.bake import baker
from patchnet.tests.blender.light_scene import assert_agrees, bake, bake_surfels, compare
from patchnet.tests.blender.objects import lamp, slab
from patchnet.tests.blender.shaders import added, glowing, grey, material, read_by, shader, shown, simple

pytestmark = pytest.mark.usefixtures("empty_scene")


def paint(kind: str, output: str | int = 0, **settings: object) -> bpy.types.Material:
    """A material that emits what a node with these settings yields."""
    return glowing(read_by(kind, output, name="The node", **settings), "Paint")


def warnings(surface: bpy.types.Material, turned: bool = False) -> tuple[str, ...]:
    slab(paint=surface).rotation_euler.z = 0.5 if turned else 0.0
    return bake(depth=3, max_samples=2).light.warnings


LOST = [
    ("AmbientOcclusion", {"inside": True}),
    ("AmbientOcclusion", {"only_local": True}),
    ("Bevel", {}),
    ("BsdfRayPortal", {}),
    ("LightPath", {"output": "Ray Length"}),
    ("TexCoord", {"output": "Reflection"}),
    ("VectorTransform", {"convert_from": "WORLD", "convert_to": "CAMERA"}),
    ("VectorTransform", {"convert_from": "OBJECT", "convert_to": "WORLD", "vector_type": "POINT"}),
]
LOST_WHEN_TURNED = [
    ("VectorTransform", {"convert_from": "OBJECT", "convert_to": "WORLD", "vector_type": "NORMAL"}),
    ("NormalMap", {"space": "OBJECT"}),
    ("TexImage", {"projection": "BOX"}),
]
KEPT = [
    ("AmbientOcclusion", {}),
    ("LightPath", {"output": "Is Camera Ray"}),
    ("NormalMap", {"space": "WORLD"}),
    ("TexCoord", {"output": "Generated"}),
]


@pytest.mark.parametrize(("kind", "settings"), LOST + LOST_WHEN_TURNED)
def test_what_is_lost_is_named(kind: str, settings: dict) -> None:
    (warning,) = warnings(paint(kind, **settings), turned=(kind, settings) in LOST_WHEN_TURNED)
    assert "'Paint'" in warning and "'The node'" in warning


@pytest.mark.parametrize(("kind", "settings"), KEPT + LOST_WHEN_TURNED)
def test_what_is_kept_is_not(kind: str, settings: dict) -> None:
    assert warnings(paint(kind, **settings), turned=(kind, settings) in KEPT) == ()


@pytest.mark.parametrize(
    "surface",
    [
        ("SubsurfaceScattering", {"Scale": 0.3}),
        ("BsdfPrincipled", {"Subsurface_Weight": 1.0, "Subsurface_Scale": 0.3, "Specular_IOR_Level": 0.0}),
    ],
)
def test_scattering_under_surfaces_is_baked_as_diffuse_and_named(surface: tuple[str, dict]) -> None:
    kind, inputs = surface
    lamp("SUN", 3.0, angle=0.0)
    (warning,) = warnings(simple(kind, "Wax", **inputs))
    assert "'Wax'" in warning
    top = bake(depth=5, max_samples=4).fragments
    top = top.only(top.place[:, 2] > -1e-5)
    color = inputs.get("Color", (0.8, 0.8, 0.8))[0]
    assert top.mean == pytest.approx(3.0 * color / np.pi, rel=0.05)


@pytest.mark.parametrize("output", ["Is Camera Ray", "Is Shadow Ray", "Ray Depth"])
def test_kinds_of_rays(output: str) -> None:
    """Shaders that a camera ray alone would see are seen by the bake."""
    surface = paint("LightPath", output)
    tree = surface.node_tree
    shown(tree, added(tree, tree.nodes["Emission"].outputs[0], shader(tree, "BsdfDiffuse")))
    slab(paint=surface)
    lamp("POINT", 5.0, shadow_soft_size=0.1)
    found = compare(1024)
    assert_agrees(found)
    assert np.ptp(found.rendered) > 0.05


def test_bumps() -> None:
    """Bump and displacement that only bends normals."""
    surface, tree = material("Bumps")
    bump, noise = tree.nodes.new("ShaderNodeBump"), tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value = 1.0
    bump.inputs["Distance"].default_value = 1.0
    noise.inputs["Detail"].default_value = 0.0
    tree.links.new(noise.outputs[0], bump.inputs["Height"])
    diffuse = shader(tree, "BsdfDiffuse")
    tree.links.new(bump.outputs[0], diffuse.node.inputs["Normal"])
    shown(tree, diffuse)
    slab(paint=surface)
    lamp("SUN", 3.0, angle=0.0).rotation_euler.y = 0.6
    assert_agrees(compare(), contrast=0.1)


def test_many_calls_have_the_same_light(monkeypatch: pytest.MonkeyPatch, bakes: list[str]) -> None:
    for number in range(6):
        slab(f"Slab {number}", grey(), low=(-1.0 + 0.3 * number, -1.0))
    lamp("POINT", 50.0)
    whole = bake_surfels(4).luminance
    once = len(bakes)
    monkeypatch.setattr(baker, "most_paths", lambda _count: 1024)
    parts = bake_surfels(4).luminance
    assert whole.any() and np.array_equal(parts, whole)
    assert len(bakes) - once > 3 * once
