# SPDX-License-Identifier: GPL-3.0-or-later
"""Sampling-map networks of the literature: losses, resumed training, files, evaluation."""

import json

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.runtime.errors import OutputError, SettingError, WeightsFileError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.training.commands import main
from patchnet.training.evaluation import evaluate
from patchnet.training.evaluation.map_frames import rendered_frames
from patchnet.training.evaluation.networks import NAMES
from patchnet.training.evaluation.networks.frames import (
    NEEDS,
    gbuffer,
)
from patchnet.training.evaluation.networks.maps import MAP, map_hash, map_networks, map_strategy, read_map, save_map
from patchnet.training.evaluation.strategies import strategies_in_use
from patchnet.training.evaluation.tracks import TrackSettings
from patchnet.training.strategies.registry import EVALUATED

torch = pytest.importorskip("torch")

from patchnet.training.evaluation.networks import kuznetsov, train_maps  # noqa: E402
from patchnet.training.evaluation.networks.weiss import pull_push  # noqa: E402

NETWORKS = map_networks()
STRATEGY_NAMES = {"weiss": "witw20", "kuznetsov": "kkr18", "unet": "ss-unet"}
SIZE = ["--size", "32", "24"]
TRACK = TrackSettings(16, 2, (32, 24))


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """One thread of torch: with several, a product's partial sums are added as they come, now and then rounded anew."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def frames_folder(shells_path, tmp_path_factory):
    """Rendered frames of the track that WORDS of the command name."""
    folder = tmp_path_factory.mktemp("frames")
    drain(rendered_frames([shells_path], TRACK, folder))
    return folder


@pytest.fixture(scope="module")
def frames(shells_path, frames_folder):
    return drain(rendered_frames([shells_path], TRACK, frames_folder))


@pytest.fixture(scope="module")
def buffers(shells_path):
    camera = Camera.look_at(np.array([1.6, -1.2, 0.9]), np.zeros(3), size_px=(33, 21))
    strategy = type("Needy", (), {"needs": NEEDS})()
    return drain(trace_view(load_octree(shells_path), camera, [strategy], reference=False))


def trained(frames, name, out, **others):
    """Train on frames for a few steps; returns the weights file."""
    options = {key: others.pop(key) for key in ("resume", "stop_after") if key in others}
    settings = train_maps.MapSettings(name, **({"steps": 4, "batch": 1, "crop": 16, "rate": 1e-3} | others))
    return drain(train_maps.train_maps(*frames, settings, train_maps.RunOptions(out, **options)))


@pytest.fixture(scope="module")
def maps(frames, tmp_path_factory):
    """Weights file of each network."""
    folder = tmp_path_factory.mktemp("maps")
    return {name: trained(frames, name, folder / name) for name in NAMES}


@pytest.mark.parametrize("name, millions", [("weiss", 0.484), ("kuznetsov", 1.070), ("unet", 1.069)])
def test_number_of_weights(name, millions):
    count = sum(values.numel() for values in NETWORKS[name].build().parameters())
    assert round(count / 1e6, 3) == millions


@pytest.mark.parametrize("name", NAMES)
def test_a_resumed_run_ends_with_the_same_weights(name, frames, maps, tmp_path):
    trained(frames, name, tmp_path, stop_after=2)
    assert map_hash(tmp_path / MAP) != map_hash(maps[name])
    assert map_hash(trained(frames, name, tmp_path, resume=True)) == map_hash(maps[name])
    longer = trained(frames, name, tmp_path, resume=True, steps=5)
    assert read_map(longer)[1]["steps"] == 5
    with pytest.raises(SettingError, match="already contains a run"):
        trained(frames, name, tmp_path)
    with pytest.raises(SettingError, match="other values of seed"):
        trained(frames, name, tmp_path, resume=True, seed=1)
    (tmp_path / "checkpoint.pt").write_bytes((tmp_path / "checkpoint.pt").read_bytes()[:5000])
    with pytest.raises(OutputError, match="is not a checkpoint"):
        trained(frames, name, tmp_path, resume=True)


@pytest.mark.parametrize("name", NAMES)
def test_strategy_of_a_weights_file(name, maps, buffers):
    strategy = map_strategy(maps[name])
    assert strategy.name == STRATEGY_NAMES[name] and strategy.name not in EVALUATED
    assert strategy.group == "screen-space" and strategy.extra_rays == 0
    assert "retrained here, 4 steps on 8 frames" in strategy.description
    scores = strategy.scores(buffers)
    network = NETWORKS[name]
    model = network.build()
    model.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in read_map(maps[name])[0].items()})
    with torch.inference_mode():
        expected = network.scores(model, torch.from_numpy(network.planes(gbuffer(buffers)))[None]).numpy().ravel()
    np.testing.assert_allclose(scores, expected, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(scores, map_strategy(maps[name]).scores(buffers))


def test_a_file_that_is_no_map_is_refused(maps, shells_path, tmp_path):
    arrays, notes = read_map(maps["unet"])
    damaged = bytearray(maps["unet"].read_bytes())
    damaged[-20] ^= 255
    (tmp_path / "damaged").write_bytes(bytes(damaged))
    save_map(tmp_path / "foreign", "moon", arrays, {})
    save_map(tmp_path / "mixed", "weiss", arrays, notes)
    save_map(tmp_path / "endless", "unet", {key: value * np.float32(np.inf) for key, value in arrays.items()}, notes)
    for path, message in (
        (tmp_path / "missing", "does not exist"),
        (tmp_path / "damaged", "is damaged"),
        (tmp_path / "foreign", "the network 'moon'"),
        (tmp_path / "mixed", "does not match the layers"),
        (tmp_path / "endless", "not finite"),
        (shells_path, "octree file where a sampling-map file is needed"),
    ):
        with pytest.raises(WeightsFileError, match=message):
            map_strategy(path)
    with pytest.raises(SettingError, match="a second file of strategy 'ss-unet'"):
        strategies_in_use((maps["unet"], maps["unet"]))


def test_sampling_map_has_four_samples_in_the_mean():
    output = 3 * torch.randn(2, 40, 50, generator=torch.Generator().manual_seed(1))
    samples = kuznetsov.sampling_map(output)
    counts = samples.round().clamp(min=1)
    np.testing.assert_allclose(counts.mean(dim=(1, 2)), 4.0, rtol=0.05)
    assert torch.equal(samples.flatten(1).argsort(), output.flatten(1).argsort()), "it grows with the output"


def test_renderer_simulator_and_its_gradient():
    pictures = torch.tensor([0.0, 0.4, 0.6, 0.8]).reshape(1, 4, 1, 1).expand(1, 4, 1, 7)
    samples = torch.tensor([[[1.0, 2.5, 4.0, 10.0, 16.0, 64.0, 256.0]]], requires_grad=True)
    picture = kuznetsov.SampledPicture.apply(samples, pictures, torch.ones(1, 1, 7))
    np.testing.assert_allclose(picture.detach().ravel(), [0.0, 0.2, 0.4, 0.5, 0.6, 0.8, 0.9], atol=1e-6)
    picture.sum().backward()
    np.testing.assert_allclose(samples.grad, (1 - picture.detach()) / samples.detach(), rtol=1e-6)


def test_pull_push_keeps_samples_and_fills_between():
    values = torch.rand(1, 13, 18, generator=torch.Generator().manual_seed(2))
    np.testing.assert_allclose(pull_push(values, torch.ones_like(values)), values, atol=1e-6)
    sparse = torch.zeros_like(values)
    sparse[:, ::5, ::4] = 1
    constant = torch.full_like(values, 0.3)
    np.testing.assert_allclose(pull_push(constant * sparse, sparse), constant, atol=1e-4)
    filled = pull_push(values, sparse)
    np.testing.assert_allclose(filled[:, ::5, ::4], values[:, ::5, ::4], atol=1e-6)
    weights = sparse.clone().requires_grad_(True)
    pull_push(values, weights).sum().backward()
    assert weights.grad is not None and weights.grad.isfinite().all() and weights.grad.abs().max() > 0


def test_train_maps_command(shells_path, frames_folder, tmp_path, capsys):
    words = ["lab", "train-maps", str(shells_path), "--network", "weiss", "--out", str(tmp_path), "--steps", "2", *SIZE]
    words += ["--frames", "16", "--every", "2", "--batch", "1", "--crop", "16", "--frames-folder", str(frames_folder)]
    words += ["--device", "cpu"]
    assert main(words) == 0
    assert MAP in capsys.readouterr().out
    assert map_strategy(tmp_path / MAP).name == STRATEGY_NAMES["weiss"]
    assert main(words) == 2 and "--resume" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, message",
    [
        (["none.safetensors", "--network", "unet", "--steps", "1"], "none.safetensors"),
        (["none.safetensors", "--network", "unet", "--steps", "1", "--resume"], "without --resume"),
    ],
)
def test_what_cannot_be_trained_is_refused(words, message, tmp_path, capsys):
    assert main(["lab", "train-maps", *words, "--out", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


def test_evaluation_with_maps(shells_path, maps, tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(evaluate, "_COST_FRAMES", 1)
    monkeypatch.setattr(evaluate, "_COST_REPEATS", 1)
    words = ["lab", "evaluate", str(shells_path), "--frames", "8", "--every", "2", *SIZE, "--processes", "1"]
    words += ["--out", str(tmp_path / "out"), "--maps", *map(str, maps.values())]
    assert main(words) == 0
    results = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    values, names = results["scenes"]["shells"], set(STRATEGY_NAMES.values())
    assert values["mse"].keys() == EVALUATED.keys() | names == values["group"].keys() == values["rays_per_pixel"].keys()
    assert all(values["group"][name] == "screen-space" and values["rays_per_pixel"][name] == 1 for name in names)
    assert all(values["ms_per_frame"][name] > 0 for name in names)
    for curves in ("intervals", "excess_area"):
        assert values[curves].keys() == values["mse"].keys()
    tables = (tmp_path / "out" / "tables.md").read_text(encoding="utf-8")
    figure = (tmp_path / "out" / "figures" / "shells-budget.svg").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in tables and f"<!-- {name} -->" in figure for name in names)
    assert results["maps"].keys() == names
    assert main([*words[:-3], str(shells_path)]) == 2
    assert "sampling-map file is needed" in capsys.readouterr().err
