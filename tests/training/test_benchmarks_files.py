# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks of octree files: the octree they make, opening it, and the bytes of its nodes."""

import json

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.commands.benches import nodes as nodes_command
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.training.benchmarks.shells import octree_of_shells, shell_radii, shell_triangles


@pytest.fixture
def octree_file(tmp_path):
    path = tmp_path / "random.safetensors"
    save_octree(random_octree(), path)
    return path


def said_json(capsys):
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    return values


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


def test_open_makes_its_own_file(capsys):
    assert main(["bench", "open", "--nodes", "3000", "--repeats", "2", "--json"]) == 0
    values = said_json(capsys)
    assert (values["name"], values["unit"], values["clock"]) == ("open", "s", "wall")
    assert values["nodes"] >= 3000 and len(values["ours_runs"]) == 2
    assert values["file_bytes"] >= 14 * values["nodes"] and values["peer_bytes"] >= 14 * values["nodes"]


def test_open_takes_a_file_and_leaves_it_alone(octree_file, capsys):
    before = octree_file.read_bytes()
    assert main(["bench", "open", str(octree_file), "--repeats", "1"]) == 0
    assert f"random.safetensors: {random_octree().node_count:,} nodes" in capsys.readouterr().out
    assert octree_file.read_bytes() == before and len(list(octree_file.parent.iterdir())) == 1


def test_bytes_of_nodes_add_up(octree_file, capsys):
    assert main(["bench", "nodes", str(octree_file), "--json"]) == 0
    values = said_json(capsys)
    octree = load_octree(octree_file)
    *fields, total = values["fields"]
    per_node = {row["field"]: row["memory_per_node"] for row in fields}
    assert {name: per_node[name] for name in ("child_mask", "first_child", "area_world", "luminance", "normal")} == {
        "child_mask": 1, "first_child": 4, "area_world": 4, "luminance": 2, "normal": 3
    }  # fmt: skip
    for column in ("memory_per_node", "memory_per_leaf", "disk_per_node", "disk_per_leaf"):
        assert total[column] == pytest.approx(sum(row[column] for row in fields))
    assert total["disk_per_node"] * octree.node_count == pytest.approx(octree_file.stat().st_size)
    assert total["disk_per_leaf"] * octree.leaf_count == pytest.approx(octree_file.stat().st_size)
    assert values["ours"] == total["disk_per_node"] and values["ratio"] == pytest.approx(5 / values["ours"])
    assert values["within_bar"] == (values["ours"] <= 16)


def test_bytes_of_a_scene_as_tables(monkeypatch, capsys):
    monkeypatch.setattr(nodes_command, "read_triangles", lambda scene: shell_triangles(1.0, rows=16))
    assert main(["bench", "nodes", "--scene", "a/ball.glb", "--depth", "6"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("ball.glb: depth 6")
    assert "| first_child | 4.00 |" in printed and "| sparse 64-tree, Bistro 8k | geometry |  | 0.62 |" in printed


def test_bad_input_is_named(octree_file, tmp_path, capsys):
    octree_file.write_bytes(octree_file.read_bytes()[:-1])
    for words, said in (
        (["open", str(octree_file)], "random.safetensors is truncated"),
        (["nodes", str(octree_file)], "random.safetensors is truncated"),
        (["nodes", str(tmp_path / "none")], "none does not exist"),
        (["nodes"], "--scene"),
        (["nodes", "a.safetensors", "--scene", "a.glb"], "--scene"),
        (["open", "--repeats", "0"], "--repeats"),
        (["open", "--nodes", "0"], "--nodes"),
    ):
        assert main(["bench", *words]) == 2
        assert said in capsys.readouterr().err
