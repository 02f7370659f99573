# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of the encoder: what it prints, and that both encoders work on the same corners."""

import importlib.util
import json

import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.network.encoders import MLP
from patchnet.patchnet_addon.network.weights import Weights, save_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.tests.engine.octree_samples import random_octree

SMALL = ["bench", "encode", "--nodes", "3000", "--corners", "100", "--repeats", "2"]


def check(values, threads):
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    assert (values["name"], values["unit"], values["octree"]) == ("encode", "corners per second", "shells")
    assert values["nodes"] >= 3000 and values["corners"] > 100 and 0 < values["occupied_cells"] < 1
    names = {"compiled"} | ({"torch"} if importlib.util.find_spec("torch") else set())
    assert values["corners_per_s"].keys() == names and values["runs"].keys() == names | {"octree"}
    assert values["octree_corners_per_s"] > 0 and values["all_corners"] >= values["corners"]
    assert (values["threads"], values["clock"]) == (threads, "processor" if threads == 1 else "wall")
    assert values["largest_difference"] <= 1e-4 + 1e-5 * values["largest_code"]
    if "torch" in names:
        assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])


@pytest.mark.parametrize("threads", [1, 2])
def test_so_many_threads_have_a_process_of_their_own(threads, capsys):
    assert main([*SMALL, "--threads", str(threads), "--json"]) == 0
    check(json.loads(capsys.readouterr().out.splitlines()[-1]), threads)


def test_other_weights_in_words(capsys, tmp_path):
    save_weights(Weights.random(2, encoder=MLP.of_width(64)), tmp_path / "narrow.safetensors")
    assert main([*SMALL, "--weights", str(tmp_path / "narrow.safetensors")]) == 0
    assert "Corners per second: ours" in capsys.readouterr().out


def test_an_octree_file_without_look_ahead_and_no_corners(tmp_path, capfd):
    path = tmp_path / "shallow.safetensors"
    save_octree(random_octree(depth=1, count=5), path)
    assert main(["bench", "encode", str(path)]) == 2
    said = capfd.readouterr().err
    assert "no corners to encode" in said and "`patchnet bench encode` failed on 1 threads" in said
    assert main(["bench", "encode", "--corners", "0"]) == 2
    assert "--corners 0 is outside 1 to" in capfd.readouterr().err
