# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train-networks`: plan, resumed trainings, results."""

import json
from dataclasses import replace

import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training.encoders import CONV3D, VOXCEPTION, load_weights
from patchnet.training.networks_of_paper.plan import KINDS, NetworkPlan, planned_networks
from patchnet.training.settings import TrainSettings

torch = pytest.importorskip("torch")
from patchnet.training.networks_of_paper import run as run_module  # noqa: E402  needs torch
from patchnet.training.networks_of_paper.run import NetworksRun, train_networks  # noqa: E402
from patchnet.training.run.trainer import RunOptions, train  # noqa: E402  needs torch

NAMES = ["shells", "slats", "without-shells", "without-slats", "look-ahead-1", "look-ahead-3", "conv3d", "voxception"]
SMALL = TrainSettings(passes=4 * 64, batch=64, precision="fp32", network="mixture", loss="squared")


@pytest.fixture(scope="module")
def octrees(tmp_path_factory):
    """Octree files of two scenes."""
    folder = tmp_path_factory.mktemp("octrees")
    for seed, name in enumerate(NAMES[:2], 1):
        made = {"file": f"{name}.glb"}
        save_octree(replace(spheres_and_slats(6, seed=seed), provenance=made), folder / f"{name}.safetensors")
    return {name: folder / f"{name}.safetensors" for name in NAMES[:2]}


def words(octrees, out, *more):
    files = [str(path) for path in octrees.values()]
    budget = ["--samples", "160", "--passes", "2048", "--voxels", "20", "--least-level", "3", "--threads", "1"]
    return ["lab", "train-networks", *files, *budget, "--out", str(out), *more]


@pytest.fixture(scope="module")
def out(octrees, tmp_path_factory):
    """All kinds of networks of two scenes."""
    out = tmp_path_factory.mktemp("out")
    assert main(words(octrees, out)) == 0
    return out


@pytest.fixture(scope="module")
def rows(out):
    values = json.loads((out / "networks.json").read_text(encoding="utf-8"))
    assert values["networks_of_paper"]["passes"] == 2048 and values["networks_of_paper"]["network"] == "mixture"
    return {row["network"]: row for row in values["networks"]}


def test_plan():
    scenes = ["a", "b", "c"]
    plans = {plan.name: plan for plan in planned_networks(scenes, KINDS)}
    assert plans["a"] == NetworkPlan("a", ("a",)) and plans["without-b"].scenes == ("a", "c")
    assert plans["look-ahead-3"] == NetworkPlan("look-ahead-3", ("a", "b"), lookahead=3)
    assert plans["conv3d"] == NetworkPlan("conv3d", ("a", "b"), encoder="conv3d")
    assert len(plans) == 3 + 3 + 2 + 2
    few = planned_networks(scenes, ["encoders"], unseen="a")
    assert [plan.name for plan in few] == ["without-a", "conv3d", "voxception"]
    assert all(plan.scenes == ("b", "c") for plan in few)


@pytest.mark.parametrize(
    ("scenes", "kinds", "unseen", "sentence"),
    [
        (["a", "b"], ["all"], None, "Unknown kind of networks 'all': choose from scene, without"),
        (["a", "a"], ["scene"], None, "'a' is named twice"),
        (["a"], ["scene", "encoders"], None, "name two scenes at least"),
        (["a", "b"], ["encoders"], "c", "hold out one of a, b"),
        (["a", "conv3d"], ["scene", "encoders"], "a", "Two networks would be called 'conv3d'"),
    ],
)
def test_plans_that_cannot_be(scenes, kinds, unseen, sentence):
    with pytest.raises(SettingError, match=sentence):
        planned_networks(scenes, kinds, unseen)


def test_every_network_is_trained(out, rows):
    assert list(rows) == NAMES
    for name, row in rows.items():
        weights = load_weights(out / "networks" / name / "patchnet.safetensors")
        assert weights.hash == row["hash"] and weights.lookahead == row["look_ahead"] and row["passes"] == 2048
        assert weights.metadata["octrees"].keys() == set(row["scenes"])
        assert weights.encoder_kind.name == row["encoder"]
        assert row["errors"].keys() == {"shells", "slats"} - set(row["scenes"])
    assert [rows[name]["look_ahead"] for name in ("look-ahead-1", "slats", "look-ahead-3")] == [1, 2, 3]
    for kind in (CONV3D, VOXCEPTION):
        assert rows[kind.name]["encoder_parameters"] == kind.parameters(2)


def test_what_is_done_is_skipped(octrees, out, rows, monkeypatch):
    monkeypatch.setattr(run_module, "train", lambda *_: pytest.fail("it is there"))
    monkeypatch.setattr(run_module, "weights_errors", lambda *_: pytest.fail("it is there"))
    before = (out / "networks.json").read_bytes()
    assert main(words(octrees, out)) == 0
    assert (out / "networks.json").read_bytes() == before


def run_of(out):
    notes = {"command": "patchnet lab train-networks", "versions": "these", "machine": "this"}
    options = RunOptions(out, device="cpu", threads=1, notes=notes)
    return NetworksRun(samples=400, least_level=3, settings=SMALL, voxels=20, options=options)


def test_interrupted_run_goes_on(octrees, tmp_path, monkeypatch):
    """Stopped within the second of two networks, it ends with the weights of a run that was not."""
    plans = planned_networks(list(octrees), ["scene"])
    whole = drain(train_networks(octrees, plans, run_of(tmp_path / "whole")))
    steps = train_networks(octrees, plans, run_of(tmp_path / "stopped"))
    for report in steps:
        if "slats (2 of 2)" in report.label and report.done == 2:
            break
    steps.close()
    again = []
    monkeypatch.setattr(run_module, "train", lambda *given: again.append(given[2]) or train(*given))
    resumed = drain(train_networks(octrees, plans, run_of(tmp_path / "stopped")))
    assert [(options.out.name, options.resume) for options in again] == [("slats", True)]
    assert [row["hash"] for row in resumed] == [row["hash"] for row in whole]
    assert [row["errors"] for row in resumed] == [row["errors"] for row in whole]
