# SPDX-License-Identifier: GPL-3.0-or-later
"""Training runs: learning, exact resume, files that do not fit."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.encoders import MLP, EncoderKind
from patchnet.patchnet_addon.network.weights import Weights, load_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.errors import FileFormatError, PatchNetError, SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.references.networks import NumpyEncoder, decode
from patchnet.tests.training.convolution_reference import NumpyConvolutions
from patchnet.tests.training.procedural import save_drawn, two_datasets
from patchnet.training.data.augmentation import Augmentation
from patchnet.training.data.corpus import corpus_of
from patchnet.training.data.dataset import Dataset, load_dataset
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.encoders import CONV3D, VOXCEPTION
from patchnet.training.encoders import load_weights as load_research_weights
from patchnet.training.run.run_files import read_log
from patchnet.training.settings import PRESETS, TrainSettings, preset_with

torch = pytest.importorskip("torch")
from patchnet.training.data.tensor_batch import tensor_batch  # noqa: E402  needs torch
from patchnet.training.network.patchnet import PatchNet  # noqa: E402  needs torch
from patchnet.training.run.learner import learning_rate  # noqa: E402  needs torch
from patchnet.training.run.trainer import RunOptions, train  # noqa: E402  needs torch

SETTINGS = TrainSettings(passes=6 * 256, batch=256, precision="fp32", augment=True, average=0.9, clip=1.0, warm_up=2)


@pytest.fixture(scope="module")
def datasets() -> list[Dataset]:
    return two_datasets(3)


@pytest.mark.parametrize("encoder", [MLP, CONV3D, VOXCEPTION], ids=lambda kind: kind.name)
def test_network_of_a_batch_is_that_of_the_engine(datasets: list[Dataset], encoder: EncoderKind) -> None:
    batch = corpus_of(datasets)[0].batch(np.arange(6), Augmentation.none(6))
    weights = Weights.random(3, bias=0.1, encoder=encoder)
    encode = NumpyEncoder if encoder is MLP else NumpyConvolutions
    eight = encode(weights)(batch.blocks, batch.rows).reshape(6, 8, 10)
    views = batch.ratio.shape[1]
    sides = np.stack([1 - batch.entry, batch.entry]).reshape(2, -1, 3)
    shares = [np.prod([sides[corner >> axis & 1, :, axis] for axis in range(3)], axis=0) for corner in range(8)]
    codes = np.einsum("on,noc->nc", shares, eight.repeat(views, axis=0))
    rays = batch.direction.reshape(-1, 3), batch.up.reshape(-1, 3), batch.ratio.ravel()
    expected = np.stack(decode(weights, codes, *rays, clip=False), axis=1)
    model = PatchNet(weights)
    found = model(tensor_batch(batch)).detach().numpy().reshape(-1, 2)
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert model.to_weights().hash == weights.hash


def test_learns_a_small_set(datasets: list[Dataset], tmp_path: Path) -> None:
    """The loss falls far below that of the best constant guess."""
    settings = TrainSettings(passes=150 * 256, batch=256, precision="fp32", learning_rate=2e-3, schedule="cosine")
    drain(train(datasets, settings, RunOptions(tmp_path, log_steps=10, validate_steps=1000)))
    last = read_log(tmp_path / "log.jsonl")[0][-1]
    coverage = np.concatenate([dataset.samples.views[..., 10].ravel() / 4096 for dataset in datasets])
    luminance = np.concatenate([dataset.samples.views[..., 11].ravel() / 65535 for dataset in datasets])
    seen = luminance[coverage > 0]
    assert last["coverage"] < 0.5 * np.abs(coverage - np.median(coverage)).mean()
    assert last["luminance"] < 0.5 * np.abs(seen - np.median(seen)).mean()


@pytest.mark.parametrize(("encoder", "lookahead"), [("conv3d", 1), ("voxception", 3)])
def test_every_encoder_and_look_ahead_is_trained(tmp_path: Path, encoder: str, lookahead: int) -> None:
    settings = replace(SETTINGS, network="mixture", encoder=encoder, encoder_width=0)
    weights = drain(train(two_datasets(2, lookahead), settings, RunOptions(tmp_path, stop_after=2)))
    assert (weights.encoder_kind.name, weights.lookahead, weights.kind.mixes) == (encoder, lookahead, True)
    assert load_research_weights(tmp_path / "patchnet.safetensors").hash == weights.hash


def test_resumed_run_equals_uninterrupted(datasets: list[Dataset], tmp_path: Path) -> None:
    whole = drain(train(datasets, SETTINGS, RunOptions(tmp_path / "a", log_steps=2)))
    drain(train(datasets, SETTINGS, RunOptions(tmp_path / "b", log_steps=2, stop_after=3)))
    steps = train(datasets, SETTINGS, RunOptions(tmp_path / "b", resume=True, log_steps=2))
    next(steps)
    steps.close()  # interrupted once more, in the middle
    resumed = drain(train(datasets, SETTINGS, RunOptions(tmp_path / "b", resume=True, log_steps=2)))
    assert whole.hash == resumed.hash == load_weights(tmp_path / "b" / "patchnet.safetensors").hash
    assert resumed.metadata["sample_passes"] == 6 * 256


def test_log_whose_last_line_was_cut(datasets: list[Dataset], tmp_path: Path) -> None:
    drain(train(datasets, SETTINGS, RunOptions(tmp_path, log_steps=1, stop_after=3)))
    log = tmp_path / "log.jsonl"
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines, lines[-1][:20]]))
    drain(train(datasets, SETTINGS, RunOptions(tmp_path, log_steps=1, resume=True, stop_after=4)))
    again = log.read_text().splitlines()
    assert again[: len(lines)] == lines and json.loads(again[-1])["step"] == 4
    log.write_text("\n".join([lines[0], "{", *lines[1:]]) + "\n")
    with pytest.raises(FileFormatError, match=r"log\.jsonl is damaged in line 2"):
        drain(train(datasets, SETTINGS, RunOptions(tmp_path, resume=True)))


def test_a_finished_run_goes_on_for_more_passes(datasets: list[Dataset], tmp_path: Path) -> None:
    """As one whose schedule was that of all passes from where it goes on; weights state where that was, fewer fail."""
    first = drain(train(datasets, SETTINGS, RunOptions(tmp_path)))
    assert "extended_from" not in first.metadata
    more = replace(SETTINGS, passes=2 * SETTINGS.passes, learning_rate=0.7 * SETTINGS.learning_rate)
    drain(train(datasets, more, RunOptions(tmp_path, resume=True, stop_after=8)))
    with pytest.raises(SettingError, match="other values of passes"):
        drain(train(datasets, SETTINGS, RunOptions(tmp_path, resume=True)))
    longer = drain(train(datasets, more, RunOptions(tmp_path, resume=True)))
    assert longer.metadata["sample_passes"] == 12 * 256 and longer.metadata["extended_from"] == [SETTINGS.passes]
    assert longer.hash != first.hash


def test_refuses_what_does_not_fit(datasets: list[Dataset], tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="without --resume"):
        drain(train(datasets, SETTINGS, RunOptions(tmp_path, resume=True)))
    drain(train(datasets, SETTINGS, RunOptions(tmp_path, stop_after=1)))
    with pytest.raises(SettingError, match="already contains a run"):
        drain(train(datasets, SETTINGS, RunOptions(tmp_path)))
    with pytest.raises(SettingError, match="learning_rate"):
        drain(train(datasets, replace(SETTINGS, learning_rate=0.5), RunOptions(tmp_path, resume=True)))
    with pytest.raises(SettingError, match="other values of encoder"):
        drain(train(datasets, replace(SETTINGS, encoder="conv3d", encoder_width=0), RunOptions(tmp_path, resume=True)))
    wanted, count = SampleSettings(views=4, min_level=3), 2 * datasets[0].samples.views[:, :, 0].size
    redrawn = [replace(each, samples=drain(draw_samples(each.octree, count, wanted))) for each in datasets]
    with pytest.raises(SettingError, match="other values of samples"):
        drain(train(redrawn, SETTINGS, RunOptions(tmp_path, resume=True)))
    (tmp_path / "checkpoint.pt").write_bytes(b"nothing")
    with pytest.raises(PatchNetError):
        drain(train(datasets, SETTINGS, RunOptions(tmp_path, resume=True)))


def test_dataset_file_knows_its_octree(datasets: list[Dataset], tmp_path: Path) -> None:
    octree, samples = datasets[0].octree, datasets[0].samples
    path = save_drawn(tmp_path, "a", octree, samples, SampleSettings())
    again = load_dataset(path)
    assert again.name == "a"
    np.testing.assert_array_equal(again.samples.views, samples.views)
    save_octree(datasets[1].octree, tmp_path / "a.safetensors")
    with pytest.raises(FileFormatError, match="another version"):
        load_dataset(path)
    (tmp_path / "a.safetensors").unlink()
    with pytest.raises(FileFormatError):
        load_dataset(path)


def test_schedules() -> None:
    paper = PRESETS["paper"]
    rates = [learning_rate(step, 800, paper) for step in (0, 399, 400, 699, 700, 799)]
    np.testing.assert_allclose(rates, [1e-3, 1e-3, 1e-4, 1e-4, 1e-5, 1e-5])
    improved = PRESETS["improved"]
    assert learning_rate(0, 20000, improved) < 1e-5
    assert learning_rate(499, 20000, improved) == improved.learning_rate
    assert learning_rate(20000, 20000, improved) == pytest.approx(improved.final_rate)


@pytest.mark.parametrize(("part", "width", "other"), [("decoder", 60, 48), ("encoder", 64, 128)])
def test_parts_have_the_width_that_is_asked_for(
    datasets: list[Dataset], tmp_path: Path, part: str, width: int, other: int
) -> None:
    settings = replace(SETTINGS, network="mixture", **{f"{part}_width": width})
    weights = drain(train(datasets, settings, RunOptions(tmp_path, stop_after=1)))
    assert {"decoder": weights.kind.width, "encoder": weights.encoder_kind.width}[part] == width
    with pytest.raises(SettingError, match=f"other values of {part}_width"):
        drain(train(datasets, replace(settings, **{f"{part}_width": other}), RunOptions(tmp_path, resume=True)))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"network": "paper", "decoder_width": 60}, "'paper' is 48 wide: omit --decoder-width"),
        ({"decoder_width": 50}, "Decoder width 50 is not a multiple of 6"),
        ({"decoder_width": 84}, "Decoder width 84 is outside 6 to 78: choose a multiple of 6 in this range"),
        ({"encoder": "conv3d", "encoder_width": 64}, "the width of 'conv3d': omit --encoder-width"),
        ({"encoder_width": 100}, "Encoder width 100 is not a multiple of 64"),
        ({"encoder_width": 1088}, "Encoder width 1088 is outside 64 to 1024: choose a multiple of 64 in this range"),
    ],
)
def test_widths_that_are_refused(changes: dict[str, str | int], sentence: str) -> None:
    with pytest.raises(SettingError, match=sentence):
        preset_with("improved", changes)
