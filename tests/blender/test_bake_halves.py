# SPDX-License-Identifier: GPL-3.0-or-later
"""The two halves of a bake, which estimate noise, share neither paths nor their origins."""

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles.bake import bake_luminance
from patchnet.operators.scene.read import read_scene
from patchnet.operators.scene_access.blender_version import BAKE_SPREAD
from patchnet.operators.settings.groups import LightSettings
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.chart_lookup import texel_owners
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender.objects import SQUARE, link, mesh
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import material, shader

pytestmark = pytest.mark.usefixtures("empty_scene")
STEP = 0.125  # a texel of the bake, in units of the square, of which it is a half


def ramp() -> None:
    """A square that shines with its x, from 0 at -1 to 2 at 1: a bake says where paths went out from."""
    made, tree = material("Ramp")
    geometry, split = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeSeparateXYZ")
    add = tree.nodes.new("ShaderNodeMath")
    add.inputs[1].default_value = 1.0
    emission = shader(tree, "Emission")
    node = emission.node
    tree.links.new(geometry.outputs["Position"], split.inputs[0])
    tree.links.new(split.outputs["X"], add.inputs[0])
    tree.links.new(add.outputs[0], node.inputs["Color"])
    tree.links.new(emission, tree.nodes["Material Output"].inputs["Surface"])
    link(mesh("Square", SQUARE, [(0, 1, 2, 3)], made))
    bpy.context.view_layer.update()


def baked(samples: int, denoise: bool) -> tuple[Atlas, np.ndarray]:
    """Atlas, and its texels that belong to triangles."""
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    light = LightSettings(samples=samples, denoise=denoise, gloss="off")
    atlas = drain(bake_luminance(bpy.context, source, STEP, light))
    side = atlas.charts.page_side**2
    owned = [
        np.flatnonzero(texel_owners(atlas.charts, page) >= 0) + page * side for page in range(atlas.charts.page_count)
    ]
    return atlas, np.concatenate(owned)


def test_halves_know_nothing_of_each_other() -> None:
    ramp()
    before = scene_snapshot()
    one, index = baked(1, denoise=False)
    few, _ = baked(4, denoise=True)
    many, _ = baked(1024, denoise=True)
    assert_unchanged(before)
    centre = many.texels[index, 0]
    step = np.ptp(centre) / (np.sqrt(len(index)) - 1.0)  # what a texel's side is worth, about
    np.testing.assert_allclose(one.texels[index, 0], centre, atol=0.1 * step)  # the first path is the centre's
    assert few.noise is not None and many.noise is not None
    # Both halves are off by as much as their two paths make them, in all directions.
    noise, error = few.noise[index], few.texels[index, 0] - centre
    assert (noise**2).mean() == pytest.approx((error**2).mean(), rel=0.5)
    assert abs(np.corrcoef(noise, error)[0, 1]) < 0.35
    assert np.abs(many.noise[index]).mean() < 0.2 * np.abs(noise).mean()


def test_paths_go_out_from_as_much_of_a_texel_as_is_said() -> None:
    """Two paths, one a half: their difference is that of two places in the square."""
    ramp()
    many, index = baked(1024, denoise=True)
    two, _ = baked(2, denoise=True)
    assert two.spread == BAKE_SPREAD and two.noise is not None
    step = np.ptp(many.texels[index, 0]) / (np.sqrt(len(index)) - 1.0)
    places = two.noise[index] * 2.0 / step  # apart, in texels: sqrt(1/6) of the spread for even places
    assert np.sqrt((places**2).mean()) == pytest.approx(BAKE_SPREAD / np.sqrt(6.0), rel=0.3)
