# SPDX-License-Identifier: GPL-3.0-or-later
"""The cost of depth: counts against what geometry says, the linear model, the figure, and bad settings."""

import json

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.commands.benches import depths as command
from patchnet.training.benchmarks import depths
from patchnet.training.benchmarks.depths import DepthCost, compare_depths, linear_cost, measure_depths

SQUARE = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])


def cost(depth, fragments, seconds, **values):
    return DepthCost(depth, 10, fragments, fragments // 2, fragments, seconds, 1, **values)


def test_fragments_of_a_square(peer):
    costs = list(measure_depths(SQUARE, range(3, 6), repeats=2, peer_depth=4))
    assert [row.depth for row in costs] == [3, 4, 5]
    for row in costs:
        side = 2**row.depth
        assert row.leaves == side**2 < row.nodes
        assert row.fragments == side**2 + side  # both triangles meet the cells of the diagonal
        assert row.runs == 2
    assert [row.peer_voxels for row in costs] == [7, 7, None]
    assert [row.peer_skipped for row in costs] == ["", "", "deeper than 4"]


def test_fragments_are_counted_once_where_space_is_divided_into_blocks(peer, monkeypatch):
    from patchnet.patchnet_addon.octree import voxelize

    passes = []
    plan = voxelize.plan_passes
    monkeypatch.setattr(voxelize, "plan_passes", lambda *given: passes.extend(made := plan(*given[:3], 100, 1)) or made)
    (row,) = measure_depths(SQUARE, [5], repeats=1)
    assert len(passes) > 2
    assert row.fragments == 32**2 + 32


def test_peer_is_left_out_where_memory_is_short(peer, monkeypatch):
    monkeypatch.setattr(depths, "available_memory", lambda: 1000)
    (row,) = measure_depths(SQUARE, [3], repeats=1)
    assert row.peer_seconds is None and "GiB are free" in row.peer_skipped
    result = compare_depths([row], "Open3D", all_cores=False)
    assert result.peer is None and result.ratio is None and result.details["peer_depths"] == []
    json.dumps(result.as_json())


def test_deepest_common_depth_is_compared():
    costs = [cost(7, 100, 1.0, peer_seconds=3.0), cost(8, 400, 4.0, peer_seconds=2.0), cost(9, 1600, 16.0)]
    result = compare_depths(costs, "Open3D", all_cores=True)
    assert (result.ours, result.peer, result.ratio, result.details["depth"]) == (4.0, 2.0, 0.5, 8)
    assert result.details["clock"] == "wall" and result.details["peer_depths"] == [7, 8]


def test_linear_model_finds_its_prices():
    exact = [cost(depth, 4**depth, 1e-9 * (10 * 500 + 4**depth * 30)) for depth in range(3, 8)]
    assert linear_cost(exact) == pytest.approx((500, 30, 0), abs=1e-6)
    square = [cost(depth, 4**depth, 1e-9 * 16**depth) for depth in range(3, 8)]
    assert linear_cost(square)[2] > 0.5
    triangle, fragment, _ = linear_cost([cost(depth, 4**depth, 1e-9 * (4**depth * 30 - 500)) for depth in range(3, 8)])
    assert triangle == 0 and fragment > 0


def test_command_prints_json_table_and_figure(peer, monkeypatch, capsys, tmp_path):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(command, "read_triangles", lambda scene: SQUARE)
    words = ["bench", "depths", "--scene", "a/square.glb", "--depths", "3", "5", "--repeats", "1"]
    plot = tmp_path / "cost.png"
    assert main([*words, "--plot", str(plot), "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    assert (values["name"], values["unit"], values["plot"], values["depth"]) == ("depths", "s", "cost.png", 5)
    for row in values["depths"]:
        assert row["fragments"] >= row["leaves"]
        assert row["ns_per_leaf"] * row["leaves"] == pytest.approx(1e9 * row["seconds"])
    assert values["ratio"] == pytest.approx(values["peer"] / values["ours"])
    width = int.from_bytes(plot.read_bytes()[16:20], "big")  # the header of a PNG file
    assert width == 900 and [path.name for path in tmp_path.iterdir()] == ["cost.png"]
    assert main(words) == 0
    assert "| 5 | 1,056 | 1,024 |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--depths", "9", "7"], "--depths"),
        (["--depths", "0", "7"], "--depths"),
        (["--depths", "9", "19"], "--depths"),
        (["--plot", "cost.gif"], "cost.gif"),
        (["--plot", "none/cost.png"], "cost.png"),
    ],
)
def test_bad_settings_are_named_before_anything_is_read(words, said, peer, capsys):
    assert main(["bench", "depths", "--scene", "missing.glb", *words]) == 2
    assert said in capsys.readouterr().err
