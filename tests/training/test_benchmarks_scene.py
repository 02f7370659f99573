# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of the whole job, with Blender in a process of its own, and what it is made of."""

import importlib.util
import json
import sys

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.lod.depth import coarse_octree, estimate
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.runtime.stage_clock import StageClock
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.training.benchmarks.child import run_child
from patchnet.training.benchmarks.shells import shell_triangles
from patchnet.training.benchmarks.voxelize import OurVoxels
from patchnet.training.benchmarks.whole_scene import cut

MEGABYTE = 1 << 20
linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells the memory of a process in /proc")
blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="Blender is not installed")


PEAKS = f"""
import numpy as np
from {StageClock.__module__} import StageClock
clock = StageClock(memory=True)
with clock.stage("large"):
    np.ones({100 * MEGABYTE}, np.uint8).sum()
with clock.stage("small"):
    pass
large, small = clock.stages["large"], clock.stages["small"]
assert large.peak_bytes >= large.before_bytes + {99 * MEGABYTE}, large
assert small.peak_bytes < large.peak_bytes - {50 * MEGABYTE}, small
assert clock.as_json()["peak_bytes"] >= large.peak_bytes
"""


@linux
def test_stages_know_their_own_peak():
    """In a process of its own: the system takes memory back from one that holds much of it at any time."""
    assert run_child([sys.executable, "-c", PEAKS]).code == 0


def test_a_stage_that_fails_leaves_nothing():
    clock = StageClock()
    with pytest.raises(ValueError, match="broken"), clock.stage("broken"):
        raise ValueError("broken")
    assert clock.as_json()["stages"] == {}


@pytest.mark.skipif(sys.platform == "win32", reason="no wait4")
def test_child_reports_code_output_and_memory():
    code = f"import sys; data = b'1' * {200 * MEGABYTE}; print('done'); sys.exit(3)"
    child = run_child([sys.executable, "-c", code])
    assert (child.code, child.stdout) == (3, "done\n")
    assert child.peak_bytes >= 200 * MEGABYTE and child.seconds > 0


def test_estimate_is_that_of_the_coarse_octree():
    """The bench cuts it from the octree that the job wrote, the job voxelizes it before."""
    mesh = TriangleMesh.from_arrays(shell_triangles(1.0, rows=24))
    ours = OurVoxels(shell_triangles(1.0, rows=24))
    ours.voxelize(Grid.around(mesh.bounds_world, 7))
    coarse, cut_coarse = drain(coarse_octree(mesh, 5)), cut(ours.octree, 5)
    np.testing.assert_array_equal(cut_coarse.child_mask, coarse.child_mask)
    assert cut_coarse.grid == coarse.grid and cut_coarse.leaf_count == coarse.leaf_count
    assert estimate(cut_coarse, 7) == estimate(coarse, 7)
    assert cut(ours.octree, 9).node_count == ours.octree.node_count


def ball(folder):
    corners = shell_triangles(1.0, rows=16)
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in corners.reshape(-1, 3))
    faces = "".join(f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}\n" for i in range(len(corners)))
    scene = folder / "ball.obj"
    scene.write_text(vertices + faces)
    return scene


@linux
@blender
def test_fitted_octree_of_a_small_scene(tmp_path, capfd):
    words = ["--view", "1.6", "0", "0", "0", "0", "0", "--size", "160", "120", "--memory", "3"]
    assert main(["bench", "fit", "--scene", str(ball(tmp_path)), *words, "--json"]) == 0
    values = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    fitted, uniform, estimated = values["octrees"]
    assert values["ours"] == fitted["lookahead_share"] > 0.99
    assert fitted["depth"] >= uniform["depth"] and fitted["leaves"] < uniform["leaves"] <= estimated["leaves"] * 1.3
    assert "depth" in fitted["stage_s"] and fitted["peak_bytes"] > 50 * MEGABYTE
    assert main(["bench", "fit", "--scene", str(tmp_path / "ball.obj")]) == 2
    assert "--view" in capfd.readouterr().err


@blender
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--depth", "fit"], "--view"),
        (["--depth", "7", "--view", "1", "0", "0", "0", "0", "0"], "--view"),
        (["--depth", "deep"], "'deep'"),
        (["--depth", "fit", "--view", "1", "0", "0", "0", "0", "0", "--rotate", "3"], "--rotate"),
        (["--depth", "fit", "--view", "1", "0", "0", "0", "0", "0", "--memory", "0"], "--memory"),
        (["--depth", "5", "--bisect", "w", "0.5"], "--bisect w is no axis"),
        (["--depth", "5", "--bisect", "x", "1.5"], "--bisect"),
        (["--depth", "5", "--bisect", "x", "0.5", "--rotate", "3"], "--rotate"),
        (["--depth", "fit", "--view", "1", "0", "0", "0", "0", "0", "--bisect", "x", "0.5"], "--depth fit"),
    ],
)
def test_octree_settings_that_contradict_each_other(words, said, capfd):
    assert main(["octree", "none.obj", "--out", "none.safetensors", *words]) == 2
    assert said in capfd.readouterr().err


@linux
@blender
def test_whole_job_of_a_small_scene(tmp_path, capfd):
    scene = ball(tmp_path)
    assert main(["bench", "scene", "--scene", str(scene), "--depth", "6", "--json"]) == 0
    values = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    assert (values["name"], values["unit"], values["scene"], values["depth"]) == ("scene", "B", "ball.obj", 6)
    assert list(values["stage_s"]) == ["start", "open", "read", "depth", "light", "voxelize", "save"]
    assert sum(values["stage_s"].values()) + values["other_s"] == pytest.approx(values["wall_s"])
    assert values["ours"] >= max(values["stage_peak_bytes"].values()) > 50 * MEGABYTE
    assert values["nodes"] > values["leaves"] > 4**6
    assert values["peer"] >= values["before_build_bytes"] + values["estimate_build_bytes"]
    assert values["triangles"] == pytest.approx(2 * 16 * 32, abs=64)  # those of no area at the poles may go


@blender
def test_bad_scenes_are_named(tmp_path, capfd):
    assert main(["bench", "scene", "--scene", str(tmp_path / "none.glb")]) == 2
    assert "none.glb does not exist" in capfd.readouterr().err
    (tmp_path / "bad.glb").write_text("no scene")
    assert main(["bench", "scene", "--scene", str(tmp_path / "bad.glb"), "--depth", "4"]) == 2
    assert "bad.glb did not become an octree: `patchnet octree` ended with code 2" in capfd.readouterr().err
