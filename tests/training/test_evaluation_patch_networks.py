# SPDX-License-Identifier: GPL-3.0-or-later
"""Several PatchNet networks in one evaluation: strategies, codes, costs, generalisation."""

import json
from dataclasses import replace

import pytest

from patchnet.patchnet_addon.network.weights import Weights, default_weights_path, save_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training.benchmarks.shells import octree_of_shells
from patchnet.training.commands import main
from patchnet.training.evaluation import evaluate
from patchnet.training.strategies.registry import EVALUATED

WORDS = ["--frames", "8", "--every", "2", "--size", "32", "24", "--processes", "1"]
NETWORKS = ("shells", "slats", "without-shells")
PAIRS = {f"pn-{name}{ending}" for name in NETWORKS for ending in ("", "-behind")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two octrees, the shipped weights, and two networks that were never trained."""
    folder = tmp_path_factory.mktemp("networks")
    save_octree(octree_of_shells(5_000), folder / "shells.safetensors")
    save_octree(spheres_and_slats(6, seed=1), folder / "slats.safetensors")
    (folder / "shipped").write_bytes(default_weights_path().read_bytes())
    save_weights(Weights.random(1), folder / "random-1")
    save_weights(replace(Weights.random(2), metadata={"octrees": {"a": "01"}, "sample_passes": 7}), folder / "random-2")
    save_weights(Weights.random(1, lookahead=1), folder / "near")
    return folder


@pytest.fixture(scope="module")
def out(folder):
    """An evaluation with three networks."""
    pytest.importorskip("matplotlib")
    files = zip(NETWORKS, ("shipped", "random-1", "random-2"), strict=True)
    given = [f"{name}={folder / file}" for name, file in files]
    octrees = [str(folder / f"{name}.safetensors") for name in ("shells", "slats")]
    with pytest.MonkeyPatch.context() as context:
        context.setattr(evaluate, "_COST_FRAMES", 1)
        context.setattr(evaluate, "_COST_REPEATS", 1)
        assert main(["lab", "evaluate", *octrees, *WORDS, "--networks", *given, "--out", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def results(out):
    return json.loads((out / "results.json").read_text(encoding="utf-8"))


def test_strategies_of_networks_stand_beside_all_others(results):
    values = results["scenes"]["shells"]
    for table in ("mse", "group", "rays_per_pixel", "intervals"):
        assert values[table].keys() == EVALUATED.keys() | PAIRS
    assert all(values["group"][name] == "network" for name in PAIRS)
    assert all(values["rays_per_pixel"][name] == 1 + name.endswith("-behind") for name in PAIRS)
    assert all(values["ms_per_frame"][name] > 0 for name in PAIRS)


@pytest.mark.parametrize("scene", ["shells", "slats"])
def test_the_same_weights_give_the_same_errors_and_others_do_not(results, scene):
    errors = results["scenes"][scene]["mse"]
    assert errors["pn-shells"] == errors["patchnet"] and errors["pn-shells-behind"] == errors["patchnet-behind"]
    assert errors["pn-slats"] != errors["patchnet"] and errors["pn-slats"] != errors["pn-without-shells"]


def test_every_network_has_a_predicted_picture(out, results):
    pictures = results["scenes"]["shells"]["predicted"]
    assert tuple(pictures) == ("predicted", *(f"predicted-{name}" for name in NETWORKS))
    assert pictures["predicted-shells"]["mse"] == pictures["predicted"]["mse"], "the same weights"
    assert pictures["predicted-slats"]["mse"] != pictures["predicted"]["mse"]
    assert all(picture["ms_per_frame"] > 0 for picture in pictures.values())
    assert "| `predicted-shells` | `predicted-slats` |" in (out / "tables.md").read_text(encoding="utf-8")


def test_generalisation_of_every_network_and_scene(results):
    found = results["claims"]["generalisation"]
    assert found.keys() == {"patchnet", "patchnet-behind"}
    for score, ending in (("patchnet", ""), ("patchnet-behind", "-behind")):
        cells = found[score]
        assert tuple(cells) == NETWORKS
        for network, scenes in cells.items():
            for scene, cell in scenes.items():
                errors = results["scenes"][scene]["mse"]
                expected = errors[f"pn-{network}{ending}"][30] / errors["ss-variance"][30]
                assert cell["value"] == pytest.approx(expected) and cell["low"] <= cell["value"] <= cell["high"]
                assert cell["seen"] == (scene == {"without-shells": "slats"}.get(network, network))


def test_figures_show_the_networks(out, results):
    names = {path.name for path in (out / "figures").iterdir()}
    assert {f"{name}.{ending}" for name in ("generalisation", "all-scenes") for ending in ("png", "svg")} <= names
    assert results["networks"]["without-shells"]["octrees"] == ["01"]


@pytest.mark.parametrize(
    "words, message",
    [
        (["a={}/random-1", "a={}/random-2"], "Two networks are called 'a'"),
        (["Big={}/random-1"], "A network cannot be called 'Big'"),
        (["a-behind={}/random-1"], "A network cannot be called 'a-behind'"),
        (["a={}/missing"], "missing"),
        (["a={}/shells.safetensors"], "octree file where a weights file is needed"),
        (["a={}/near"], "Network 'a' looks 1 levels ahead, the evaluation 2"),
    ],
)
def test_networks_that_cannot_be_evaluated_are_refused_before_work_begins(words, message, folder, tmp_path, capsys):
    given = [word.format(folder) for word in words]
    octree = str(folder / "shells.safetensors")
    assert main(["lab", "evaluate", octree, *WORDS, "--networks", *given, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "out").exists()
