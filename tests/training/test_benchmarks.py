# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks: what they print, that both sides work on the same input, and what is said where the peer is missing."""

import json
import os
import sys

import numpy as np
import pytest

from patchnet.commands import bench, main
from patchnet.commands.benches import voxelize as command
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.runtime.errors import PatchNetError, SettingError
from patchnet.training.benchmarks.shells import octree_of_shells, shell_radii, shell_triangles
from patchnet.training.benchmarks.timing import compare, one_core, take_turns
from patchnet.training.benchmarks.voxelize import Open3DVoxels, benchmark_voxelize, import_open3d

CORNERS = np.random.default_rng(0).uniform(0, 1, (50, 3, 3))


def test_both_get_the_same_triangles_and_voxel_size(peer):
    result = benchmark_voxelize(CORNERS, depth=5, repeats=2)
    assert len(peer.meshes) == 3  # the first is a rehearsal
    np.testing.assert_array_equal(peer.meshes[1], CORNERS)
    assert peer.sides[1] == pytest.approx(np.ptp(CORNERS.reshape(-1, 3), axis=0).max() / 32, rel=1e-4)
    assert result.details["peer_voxels"] == 7 and result.details["ours_voxels"] > 1000
    assert result.details["ours_fragments"] > result.details["ours_voxels"]
    assert result.ratio == pytest.approx(result.peer / result.ours)


def test_open3d_itself():
    try:
        import_open3d()
    except PatchNetError as reason:
        pytest.skip(str(reason))
    square = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    voxels = Open3DVoxels(square, 0.5)
    voxels.voxelize(0.1)
    assert voxels.voxel_count == len(voxels._voxels.get_voxels()) >= 100
    assert voxels.name.startswith("Open3D 0.")


@pytest.mark.parametrize("threads", [1, 2])
def test_last_line_is_json(threads, peer, monkeypatch, capsys):
    monkeypatch.setattr(command, "read_triangles", lambda scene: CORNERS)
    words = ["bench", "voxelize", "--scene", "a/soup.glb", "--depth", "4", "--repeats", "1", "--threads", str(threads)]
    assert main([*words, "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    assert (values["name"], values["unit"], values["scene"], values["depth"]) == ("voxelize", "s", "soup.glb", 4)
    assert values["clock"] == {1: "processor", 2: "wall"}[threads]
    if hasattr(os, "sched_getaffinity"):
        assert values["cores"] == {1: 1, 2: len(os.sched_getaffinity(0))}[threads]
    assert main(words) == 0
    assert "soup.glb at depth 4: octree of" in capsys.readouterr().out


@pytest.mark.parametrize("name", bench.BENCHES)
def test_help_of_every_bench(name, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["bench", name, "--help"])
    assert stop.value.code == 0
    assert f"usage: patchnet bench {name}" in (shown := capsys.readouterr().out) and "--json" in shown


def test_missing_peer_and_no_repeats_are_explained(peer, monkeypatch, capsys):
    assert main(["bench", "voxelize", "--scene", "soup.glb", "--repeats", "0"]) == 2
    assert "--repeats 0 is outside 1 to" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(PatchNetError, match=r"Open3D cannot be imported .* install patchnet-blender\[peers\]"):
        import_open3d()


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system cannot bind threads to cores")
def test_one_core_alone_and_all_of_them_afterwards():
    before = os.sched_getaffinity(0)
    with one_core() as cores:
        assert cores == len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


def test_the_median_run_counts_and_both_take_turns():
    order = []
    result = compare("turns", lambda: order.append("ours"), lambda: order.append("peer"), 3)
    assert order == ["ours", "peer"] * 3
    assert result.ours == pytest.approx(sorted(result.details["ours_runs"])[1], abs=1e-4)


@pytest.mark.parametrize("all_cores", [False, True])
def test_preparation_comes_before_each_run_and_no_run_follows_when_time_is_up(all_cores):
    order = []
    seconds = take_turns(
        {"ours": lambda: order.append("run")},
        5,
        all_cores=all_cores,
        max_seconds=0.0,
        prepare=lambda: order.append("prepare"),
    )
    assert order == ["prepare", "run"]
    assert len(seconds["ours"]) == 1


@pytest.mark.parametrize("count", [500, 130_000, 200_000])
def test_shells_have_the_nodes_that_were_asked_for(count, tmp_path):
    octree = octree_of_shells(count)
    assert count <= octree.node_count < count * (4.5 if count < 100_000 else 1.06)
    save_octree(octree, tmp_path / "shells.safetensors")
    assert load_octree(tmp_path / "shells.safetensors").node_count == octree.node_count  # consistent
    assert len(np.unique(octree.luminance)) > 100


def test_shells_lie_inside_each_other():
    radii = shell_radii(2.5)
    assert sum(radius**2 for radius in radii) == pytest.approx(2.5)
    assert (np.diff(radii) <= -0.06 + 1e-9).all()
    lengths = np.linalg.norm(shell_triangles(0.5, rows=8).reshape(-1, 3), axis=1)
    assert 0.48 <= lengths.min() < lengths.max() <= 0.5


@pytest.mark.parametrize("count", [0, -5, 1 << 40])
def test_impossible_numbers_of_nodes(count):
    with pytest.raises(SettingError, match="--nodes"):
        octree_of_shells(count)
