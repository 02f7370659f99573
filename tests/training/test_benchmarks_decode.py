# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of the decoder: what it prints, and that all of its rates are there."""

import importlib.util
import json

import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.network.kinds import PAPER
from patchnet.patchnet_addon.network.weights import Weights, save_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.training.benchmarks.timing import environment_of_threads

SMALL = ["bench", "decode", "--nodes", "30000", "--pixels", "3000", "--repeats", "2"]


def check(values, threads):
    assert (values["name"], values["unit"], values["octree"]) == ("decode", "pixels per second", "shells")
    assert values["nodes"] >= 30000 and values["pixels"] >= values["decoded_pixels"] >= 3000
    names = {"decode", "trace"} | ({"torch"} if importlib.util.find_spec("torch") else set())
    assert values["pixels_per_s"].keys() == values["runs"].keys() == names
    assert all(len(runs) == 2 for runs in values["runs"].values())
    assert (values["threads"], values["clock"]) == (threads, "processor" if threads == 1 else "wall")
    if "torch" in names:
        assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])
        assert values["torch"].startswith("torch ")


def test_in_this_process(capsys, monkeypatch):
    for name, value in environment_of_threads(2).items():
        monkeypatch.setenv(name, value)
    assert main([*SMALL, "--threads", "2", "--json"]) == 0
    check(json.loads(capsys.readouterr().out.splitlines()[-1]), 2)


def test_one_thread_in_a_process_of_its_own_with_other_weights(tmp_path, capsys):
    path = tmp_path / "paper.safetensors"
    save_weights(Weights.random(1, kind=PAPER), path)
    assert main([*SMALL, "--threads", "1", "--weights", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "threads: 1, processor seconds" in shown and "network: paper" in shown
    assert "| ours, whole decode | " in shown and "| tracing the same pixels | " in shown


def test_an_octree_file_without_look_ahead_and_no_pixels(tmp_path, capsys, monkeypatch):
    for name, value in environment_of_threads(1).items():
        monkeypatch.setenv(name, value)
    path = tmp_path / "shallow.safetensors"
    save_octree(random_octree(depth=1, count=5), path)
    assert main(["bench", "decode", str(path), "--threads", "1"]) == 2
    assert "no pixel has look-ahead" in capsys.readouterr().err
    assert main(["bench", "decode", "--pixels", "0"]) == 2
    assert "--pixels 0 is outside 1 to" in capsys.readouterr().err
