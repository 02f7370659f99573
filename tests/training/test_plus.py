# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of the error estimator: table of pixels, learner, command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network.weights import Weights, load_weights
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.runtime.errors import PatchNetError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.plus.features import features_of
from patchnet.patchnet_addon.sampling.plus.forms import FORMS, Plane
from patchnet.patchnet_addon.sampling.plus.weights import estimators_of, load_estimators
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.test_plus import ALL
from patchnet.tests.references.networks import run_layers
from patchnet.training.commands import main
from patchnet.training.plus.frames import SYMMETRIES, PixelTable, symmetries

torch = pytest.importorskip("torch")

from patchnet.training.plus.train import FormLearner, PlusSettings, train_plus  # noqa: E402
from patchnet.training.run.trainer import RunOptions  # noqa: E402

WORDS = ["--frames", "8", "--every", "1", "--size", "48", "40", "--rays", "4", "--batch", "256", "--pixels", "200"]


@pytest.fixture(scope="module")
def table(shells_path):
    octree = load_octree(shells_path)
    coded = drain(encode_octree(octree, Weights.random(seed=1)))
    parts = []
    for turn in range(3):
        eye = np.array([1.6 * np.cos(turn), 1.6 * np.sin(turn), 0.9])
        camera = Camera.look_at(eye, np.zeros(3), size_px=(40, 30))
        view = drain(trace_view(octree, camera, [ALL], coded=coded))
        parts.append(PixelTable.of(view, 150, np.random.default_rng(turn)))
    return PixelTable.joined(parts)


def test_symmetries_are_eight_and_keep_neighbours():
    orders = {tuple(places) + tuple(rays) for places, rays in symmetries()}
    assert len(orders) == SYMMETRIES == len({order[:9] for order in orders})
    whole = np.arange(36).reshape(6, 6)  # rays of a window
    for places, rays in symmetries():
        window = whole.reshape(3, 2, 3, 2).transpose(0, 2, 1, 3).reshape(9, 4)[places][:, rays]
        turned = window.reshape(3, 3, 2, 2).transpose(0, 2, 1, 3).reshape(6, 6)
        assert any(
            (turned == np.rot90(whole.T if flip else whole, turn)).all() for flip in (False, True) for turn in range(4)
        )


def test_network_says_what_was_learnt(table):
    """The moving mean with the features' mean and deviation folded in is the network that was trained."""
    rows = np.arange(len(table))
    windows = table.batch(rows, 0)
    form = FORMS["plus-1"]
    learner = FormLearner(form, windows, float(table.errors[form.shown].mean()), 1e-2, seed=0)
    for _ in range(30):
        learner.step(windows, table.errors[form.shown], 1e-2)
    with torch.no_grad():
        for parameter, moving in zip(learner.parameters, learner.moving, strict=True):
            parameter.copy_(moving)
        features, _ = features_of(windows, form, tuple(Plane))
        inputs = torch.from_numpy(((features - learner.mean[:, None]) / learner.deviation[:, None]).T.copy())
        expected = learner._outputs(inputs).numpy()
    layers, skip = learner.network()
    values = features.astype(np.float64)
    variance, mean = run_layers(layers, values.T).T
    np.testing.assert_allclose((mean + skip @ values) ** 2 + np.exp(variance), expected, rtol=1e-3, atol=1e-5)


def test_command_learns_the_same_again(shells_path, tmp_path, capsys):
    words = ["lab", "train-plus", str(shells_path), *WORDS]
    assert main([*words, "--steps", "40", "--out", str(tmp_path / "a")]) == 0
    said = capsys.readouterr().out
    assert "holds patchnet.safetensors, plus.safetensors, log.jsonl" in said and "plus-4 0." in said
    assert estimators_of(load_weights(tmp_path / "a" / "patchnet.safetensors")).metadata["steps"] == 40
    last = json.loads((tmp_path / "a" / "log.jsonl").read_text().splitlines()[-1])
    assert last["step"] == 40 and last["loss"].keys() == FORMS.keys()
    read = load_estimators(tmp_path / "a" / "plus.safetensors")
    assert read.metadata["steps"] == 40 and "shells.safetensors" in read.metadata["octrees"]
    assert main([*words, "--steps", "40", "--out", str(tmp_path / "b")]) == 0
    assert load_estimators(tmp_path / "b" / "plus.safetensors").hash == read.hash


def test_nothing_to_learn_from(table, tmp_path):
    empty = PixelTable.joined([])
    with pytest.raises(PatchNetError, match="show no surface"):
        drain(train_plus(empty, PlusSettings(), RunOptions(tmp_path)))
    wrong = replace(table, errors={name: errors * np.nan for name, errors in table.errors.items()})
    with pytest.raises(PatchNetError, match=r"not finite.*--rate"):
        drain(train_plus(wrong, PlusSettings(steps=1, batch=8), RunOptions(tmp_path)))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["none.safetensors"], "none.safetensors"),
        (["shells.safetensors", "--weights", "lost.safetensors"], "lost.safetensors"),
        (["shells.safetensors", "./shells.safetensors"], "named twice"),
    ],
)
def test_what_cannot_be_trained_is_refused(words, message, shells_path, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(shells_path.parent)
    assert main(["lab", "train-plus", *words, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
