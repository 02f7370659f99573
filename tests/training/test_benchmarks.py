# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks: what they print, that both sides work on the same input, and what is said where the peer is missing."""

import json
import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from patchnet.commands import bench, main
from patchnet.patchnet_addon.errors import PatchNetError
from patchnet.training.benchmarks.timing import compare, one_core
from patchnet.training.benchmarks.voxelize import benchmark_voxelize, import_open3d

CORNERS = np.random.default_rng(0).uniform(0, 1, (50, 3, 3))


@pytest.fixture
def peer(monkeypatch):
    """A stand-in for Open3D that keeps what it was given."""
    calls = SimpleNamespace(meshes=[], sides=[])

    def create(mesh, side):
        calls.meshes.append(mesh)
        calls.sides.append(side)
        return SimpleNamespace(get_voxels=lambda: [0] * 7)

    module = SimpleNamespace(
        __version__="0.0",
        utility=SimpleNamespace(Vector3dVector=np.asarray, Vector3iVector=np.asarray),
        geometry=SimpleNamespace(
            TriangleMesh=lambda vertices, triangles: vertices[triangles],
            VoxelGrid=SimpleNamespace(create_from_triangle_mesh=create),
        ),
    )
    monkeypatch.setitem(sys.modules, "open3d", module)
    return calls


def test_both_get_the_same_triangles_and_voxel_size(peer):
    result = benchmark_voxelize(CORNERS, depth=5, repeats=2)
    assert len(peer.meshes) == 2
    np.testing.assert_array_equal(peer.meshes[0], CORNERS)
    assert peer.sides[0] == pytest.approx(np.ptp(CORNERS.reshape(-1, 3), axis=0).max() / 32, rel=1e-4)
    assert result.details["peer_voxels"] == 7 and result.details["ours_voxels"] > 1000
    assert result.ratio == pytest.approx(result.peer / result.ours)


def test_last_line_is_json(peer, monkeypatch, capsys):
    monkeypatch.setattr(bench, "read_triangles", lambda scene: CORNERS)
    assert main(["bench", "voxelize", "--scene", "a/soup.glb", "--depth", "4", "--repeats", "1", "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    assert (values["name"], values["unit"], values["scene"], values["depth"]) == ("voxelize", "s", "soup.glb", 4)
    assert main(["bench", "voxelize", "--scene", "soup.glb", "--depth", "4", "--repeats", "1"]) == 0
    assert "soup.glb at depth 4: octree of" in capsys.readouterr().out


def test_missing_peer_and_no_repeats_are_explained(peer, monkeypatch, capsys):
    assert main(["bench", "voxelize", "--scene", "soup.glb", "--repeats", "0"]) == 2
    assert "at least 1" in capsys.readouterr().err
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
