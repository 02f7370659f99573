# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposure, chosen or given: by the panel's settings, the operators and the commands, and kept in the file."""


import bpy
import numpy as np
import pytest

from patchnet.operators.session import results
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.tests.blender.job_scene import build

pytestmark = pytest.mark.usefixtures("registered")


def leaf_luminance(octree: Octree) -> np.ndarray:
    return octree.luminance[octree.child_mask == 0] / 65535.0


def assert_scaled(given: Octree, automatic: Octree) -> None:
    """`given` shows the light of `automatic` times a smaller exposure."""
    unclamped = leaf_luminance(automatic) < 0.999
    assert unclamped.any() and given.exposure < automatic.exposure
    scaled = leaf_luminance(automatic) * given.exposure / automatic.exposure
    np.testing.assert_allclose(leaf_luminance(given)[unclamped], scaled[unclamped], atol=2e-5)


def test_operators() -> None:
    build()
    scene = bpy.context.scene
    bpy.ops.patchnet.voxelize(depth=5)
    unlit = results.voxels_of(scene).octree
    bpy.ops.patchnet.bake_light(light="two-lights")
    automatic = results.voxels_of(scene).octree
    assert automatic.provenance["exposure"] == "automatic"
    scene.patchnet.exposure = 0.25
    bpy.ops.patchnet.bake_light(light="two-lights")
    given = results.voxels_of(scene).octree
    assert (given.exposure, given.provenance["exposure"]) == (0.25, "given")
    assert_scaled(given, automatic)
    bpy.ops.patchnet.voxelize(depth=5)
    again = results.voxels_of(scene).octree
    assert again.exposure == unlit.exposure and "exposure" not in again.provenance, "a colour is not exposed"
