# SPDX-License-Identifier: GPL-3.0-or-later
"""The two parts of a surfel's paths tell its noise, and share no paths."""

import bpy
import numpy as np
import pytest

from patchnet.tests.blender.light_scene import BakedSurfels, bake_surfels
from patchnet.tests.blender.objects import SQUARE, lamp, link, mesh
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import glowing, grey, read_by

pytestmark = pytest.mark.usefixtures("empty_scene")
DEPTH = 5  # of the voxels, whose side is 2 / 32


def ramp() -> None:
    """A square that shines with its x, from 0 at -1 to 2 at 1: a bake says where paths went out from."""

    def place(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        split, add = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeMath")
        add.inputs[1].default_value = 1.0
        tree.links.new(read_by("NewGeometry", "Position")(tree), split.inputs[0])
        tree.links.new(split.outputs["X"], add.inputs[0])
        return add.outputs[0]

    link(mesh("Square", SQUARE, [(0, 1, 2, 3)], glowing(place)))
    bpy.context.view_layer.update()


def baked(samples: int, seed: int = 0) -> tuple[BakedSurfels, np.ndarray]:
    """Surfels of whole voxels of the front, with (N,) half the difference of their two parts."""
    found = bake_surfels(samples, DEPTH, seed, gloss="off")
    found = found.only((found.surfels["side"] == 0) & (found.surfels["area"] > 0.9 * (2.0 / 2**DEPTH) ** 2))
    assert len(found.surfels) > 100
    return found, np.abs(found.half)


def test_noise_is_that_of_the_paths() -> None:
    """Of three suns each path meets one. Both parts are off by as much as their paths make them."""
    link(mesh("Square", SQUARE, [(0, 1, 2, 3)], grey()))
    for strength in (1.0, 2.0, 6.0):
        lamp("SUN", strength, angle=0.0)
    bpy.context.scene.cycles.use_light_tree = False
    bpy.context.view_layer.update()
    before = scene_snapshot()
    few, noise = baked(4)
    many, less = baked(1024)
    assert_unchanged(before)
    wanted = 9.0 * 0.5 / np.pi
    np.testing.assert_allclose(many.luminance, wanted, rtol=0.02)
    error = few.luminance - wanted
    assert (noise**2).mean() == pytest.approx((error**2).mean(), rel=0.5)
    assert less.mean() < 0.2 * noise.mean()
    other = baked(4, seed=1)[0].luminance - wanted
    assert abs(np.corrcoef(error, other)[0, 1]) < 0.35, "rounds share no paths"


def test_paths_go_out_from_all_of_a_surfel() -> None:
    """Their mean is the light at its centre. Both parts are halves of it, so that what varies there counts as noise."""
    ramp()
    few, noise = baked(4)
    many, _ = baked(1024)
    np.testing.assert_allclose(many.luminance, many.place[:, 0] + 1.0, atol=0.01)
    error = few.luminance - many.luminance
    assert 0.0 < (error**2).mean() < (noise**2).mean()
    radius = np.sqrt((2.0 / 2**DEPTH) ** 2 / (3.0 * 3.0**0.5 / 4.0))  # of the triangle of a voxel's area
    assert 0.2 * radius < np.sqrt((noise**2).mean()) < 0.5 * radius
