# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colours that only Cycles knows keep their contrast, however large the light cells are."""

import bpy
import numpy as np
import pytest

from patchnet.tests.blender.light_scene import bake
from patchnet.tests.blender.objects import lamp, slab
from patchnet.tests.blender.shaders import material, shader, shown, simple, world

pytestmark = pytest.mark.usefixtures("empty_scene")

WHITE, DARK, SIDE = 0.8, 0.05, 0.25  # of a square, in the world
DEPTH = 5
LEAF = 2.0 / 2**DEPTH


def checkered(dark: float = DARK, side: float = SIDE) -> bpy.types.Material:
    """Squares of two colours, whose corners lie at multiples of `side`."""
    paint, tree = material("Checkered")
    checker = tree.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Scale"].default_value = 1.0 / side
    for name, value in (("Color1", WHITE), ("Color2", dark)):
        checker.inputs[name].default_value = (value, value, value, 1.0)
    raised = tree.nodes.new("ShaderNodeVectorMath")  # coordinates on the edge of two squares are noise
    raised.inputs[1].default_value = (0.0, 0.0, 0.5 * side)
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], raised.inputs[0])
    tree.links.new(raised.outputs[0], checker.inputs["Vector"])
    surface = shader(tree, "BsdfDiffuse")
    tree.links.new(checker.outputs["Color"], surface.node.inputs["Color"])
    shown(tree, surface)
    return paint


@pytest.mark.parametrize("dark", [DARK, 0.0])
@pytest.mark.parametrize("color", [False, True])
def test_squares_of_few_voxels_have_their_colour(color: bool, dark: float) -> None:
    """Under an even sky, which shows colours as they are; light cells have two leaves a side."""
    world().nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    slab(paint=checkered(dark))
    found = bake(depth=DEPTH, color=color, max_samples=16).fragments
    inner = np.abs((found.place[:, :2] / SIDE) % 1.0 - 0.5) < 0.5 - 0.75 * LEAF / SIDE
    found = found.only((found.place[:, 2] > -1e-4) & inner.all(axis=1))
    squares = np.floor(found.place[:, :2] / SIDE).astype(int).sum(axis=1) % 2
    means = sorted(found.only(squares == each).mean for each in (0, 1))
    assert means == pytest.approx([dark, WHITE], abs=0.02)
    for each in (0, 1):
        assert np.ptp(found.luminance[squares == each]) < 0.1, "no square is smeared"


def test_leaves_between_rays_have_their_colour() -> None:
    """Rays of a small picture skip leaves that are far smaller than its pixels."""
    world().nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    side, leaf = 0.11, 2.0 / 2**9
    slab(paint=checkered(side=side))
    found = bake(depth=9, max_samples=16, cameras=["0 -1.3 0.8 > 0 0 0"]).fragments
    inner = np.abs((found.place[:, :2] / side) % 1.0 - 0.5) < 0.5 - 4.0 * leaf / side
    ahead = np.abs(found.place[:, :2]).max(axis=1) < 0.4
    found = found.only((found.place[:, 2] > -1e-4) & inner.all(axis=1) & ahead)
    squares = np.floor(found.place[:, :2] / side).astype(int).sum(axis=1) % 2
    means = sorted(found.only(squares == each).mean for each in (0, 1))
    assert means == pytest.approx([DARK, WHITE], abs=0.02)


def test_noise_of_glowing_surfaces_is_filtered() -> None:
    slab(paint=simple("BsdfPrincipled", Subsurface_Weight=0.5, Emission_Strength=0.1, Specular_IOR_Level=0.0))
    lamp("AREA", 50.0, (0.0, 0.0, 1.5), size=2.0)
    rough, smooth = (bake(depth=DEPTH, max_samples=4, denoise=denoise).fragments for denoise in (False, True))
    noise = [np.std(found.luminance[found.place[:, 2] > -1e-4]) for found in (rough, smooth)]
    assert smooth.mean == pytest.approx(rough.mean, rel=0.02) and noise[1] < 0.8 * noise[0]
