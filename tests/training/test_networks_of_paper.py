# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train-networks`: plan, resumed trainings, results."""

import json
from dataclasses import replace

import pytest

from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training.commands import main
from patchnet.training.commands.lab.train_networks import KINDS, NetworkPlan, planned_networks
from patchnet.training.data.dataset import load_dataset
from patchnet.training.encoders import load_weights

pytest.importorskip("torch")
from patchnet.training.run.run_files import LOG, read_log
from patchnet.training.run.validation import weights_errors

NAMES = ["shells", "slats", "without-shells", "without-slats", "look-ahead-1", "look-ahead-3", "conv3d", "voxception"]


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
    budget = ["--samples", "160", "--passes", "4096", "--voxels", "20", "--least-level", "3", "--threads", "1"]
    return ["lab", "train-networks", *files, *budget, "--out", str(out), *more]


def rows_of(out):
    return json.loads((out / "errors.json").read_text(encoding="utf-8"))["errors"]


@pytest.fixture(scope="module")
def out(octrees, tmp_path_factory):
    """All kinds of networks of two scenes."""
    out = tmp_path_factory.mktemp("out")
    assert main(words(octrees, out)) == 0
    return out


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


def test_every_network_is_trained(out):
    found = rows_of(out)
    assert list(found) == NAMES
    plans = {plan.name: plan for plan in planned_networks(NAMES[:2], KINDS)}
    for name, row in found.items():
        weights, plan = load_weights(out / "networks" / name / "patchnet.safetensors"), plans[name]
        assert weights.hash == row["weights_hash"] and weights.lookahead == plan.lookahead
        assert weights.metadata["sample_passes"] == 4096 and weights.kind.mixes
        assert weights.metadata["octrees"].keys() == set(plan.scenes)
        assert weights.encoder_kind.name == plan.encoder
        assert row["scenes"].keys() == {"shells", "slats"} - set(plan.scenes)
        for scene, errors in row["scenes"].items():
            samples = out / "samples" / f"look-ahead-{plan.lookahead}" / f"{scene}.samples.safetensors"
            assert errors == weights_errors(weights, load_dataset(samples), 20)


def test_what_is_done_is_kept_and_shown(octrees, out, capsys):
    before = (out / "errors.json").read_bytes()
    steps = {name: read_log(out / "networks" / name / LOG)[0] for name in NAMES}
    assert main(words(octrees, out)) == 0
    assert (out / "errors.json").read_bytes() == before
    assert {name: read_log(out / "networks" / name / LOG)[0] for name in NAMES} == steps
    assert f"| slats | {shown(rows_of(out)['slats']['scenes']['shells'])} | seen |" in capsys.readouterr().out
    assert main(words(octrees, out, "--least-level", "4")) == 2
    assert "was drawn with other arguments: delete it" in capsys.readouterr().err


def shown(errors):
    return f"{errors['coverage']:.3f} ({errors['luminance_ratio']:.2f})"


def test_interrupted_run_goes_on(octrees, out, tmp_path):
    """Stopped within the second of two networks, it ends with the weights of a run that was not."""
    kind = ["--kinds", "scene"]
    assert main(words(octrees, tmp_path, *kind)) == 0
    (tmp_path / "networks" / "slats").rename(tmp_path / "finished")
    samples = tmp_path / "samples" / "look-ahead-2" / "slats.samples.safetensors"
    run = ["--out", str(tmp_path / "networks" / "slats"), "--passes", "4096", "--threads", "1", "--stop-after", "1"]
    assert main(["lab", "train", str(samples), *run]) == 0
    assert main(words(octrees, tmp_path, *kind)) == 0
    assert [line["step"] for line in read_log(tmp_path / "networks" / "slats" / LOG)[0]] == [1, 2]
    assert rows_of(tmp_path) == {name: row for name, row in rows_of(out).items() if name in octrees}
