# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposure, chosen or given: by the panel's settings, the operators and the commands, and kept in the file."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.session import results
from patchnet.patchnet_addon.octree.file import load_octree
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


def test_octree_command(scene_file: Path, tmp_path: Path) -> None:
    made = {}
    for name, more in {"automatic": [], "given": ["--exposure", "0.125"]}.items():
        path = tmp_path / f"{name}.safetensors"
        arguments = ["octree", str(scene_file), "--depth", "5", "--light", "two-lights", "--out", str(path)]
        assert commands.main([*arguments, *more]) == 0
        made[name] = load_octree(path)
        assert made[name].provenance["exposure"] == name
    assert made["given"].exposure == 0.125
    assert_scaled(made["given"], made["automatic"])


@pytest.mark.parametrize("value", ["0", "nan"])
def test_impossible_exposures(
    value: str, scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", str(scene_file), "--depth", "5", f"--exposure={value}", "--out", str(tmp_path / "out")]
    assert commands.main(arguments) == 2
    assert "is outside" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
