# SPDX-License-Identifier: GPL-3.0-or-later
"""Training on devices and by any number of threads: the same batches, the same steps to rounding, runs that move."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.network.kinds import MIXTURE
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.torch_devices import DEVICES, GPU, gpu_only
from patchnet.tests.training.procedural import save_drawn, spheres_and_slats
from patchnet.training.data.augmentation import Augmentation
from patchnet.training.data.corpus import corpus_of
from patchnet.training.data.dataset import Dataset
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.settings import SQUARED, TrainSettings

torch = pytest.importorskip("torch")
from patchnet.training.data.tensor_batch import tensor_batch  # noqa: E402  needs torch
from patchnet.training.run.learner import Learner  # noqa: E402  needs torch
from patchnet.training.run.steps import StepPlan, augmentation_of_step, batches_ahead, rows_of_step  # noqa: E402
from patchnet.training.run.trainer import RunOptions, encoder_type, train  # noqa: E402  needs torch

SETTINGS = TrainSettings(passes=6 * 256, batch=256, precision="fp32", augment=True, average=0.9, clip=1.0, warm_up=2)
VOXELS = 64
GRADIENTS = 5e-3  # of the norm: on a GPU a ReLU's input may round to the other side of zero
ERRORS = 1e-3  # relative, of the curves of a short run


MIXING = replace(SETTINGS, network=MIXTURE.name, loss=SQUARED)


def drawn(lookahead: int) -> list[Dataset]:
    found = []
    for seed in (1, 2):
        octree = spheres_and_slats(6, seed=seed)
        settings = SampleSettings(views=4, min_level=2, held_out=0.05, seed=seed, lookahead=lookahead)
        samples = drain(draw_samples(octree, 400, settings))
        found.append(Dataset(f"scene {seed}", octree, samples, {"settings": {"lookahead": lookahead}}))
    return found


@pytest.fixture(scope="module")
def datasets() -> list[Dataset]:
    return drawn(2)


def curve(folder: Path) -> np.ndarray:
    """Coverage and luminance errors (n, 2) of a log."""
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return np.array([(line["coverage"], line["luminance"]) for line in lines if "coverage" in line])


@pytest.mark.parametrize("encoder", ["mlp", "conv3d"])
@pytest.mark.parametrize("settings", [SETTINGS, MIXING], ids=["paper", "mixture"])
@pytest.mark.parametrize("lookahead", [1, 2, 3])
@gpu_only
def test_a_gpu_says_and_learns_the_same(lookahead: int, settings: TrainSettings, encoder: str) -> None:
    settings = replace(settings, encoder=encoder, encoder_width=0)
    corpus, _ = corpus_of(drawn(lookahead), nearby=settings.kind.mixes)
    plan = StepPlan(corpus, settings, VOXELS)
    there, here = Learner(settings, lookahead, "cuda"), Learner(settings, lookahead)
    ahead = batches_ahead(plan, 0, 3, there.device, 3)
    for step, batch in enumerate(ahead):
        wanted, errors = here.differentiate(tensor_batch(plan.batch(step)), torch.float32)
        gradients, found = there.differentiate(batch, torch.float32)
        torch.testing.assert_close(found.cpu(), errors, rtol=1e-5, atol=1e-6)
        for mine, theirs in zip(wanted, gradients, strict=True):
            assert (theirs.cpu() - mine).norm() <= GRADIENTS * mine.norm()


def test_batches_ahead_are_those_of_the_steps(datasets: list[Dataset]) -> None:
    plan = StepPlan(corpus_of(datasets)[0], SETTINGS, VOXELS)
    found = list(batches_ahead(plan, 3, 6, torch.device("cpu"), 2))
    assert len(found) == 3
    for step, batch in enumerate(found, 3):
        assert torch.equal(batch.blocks, torch.from_numpy(plan.batch(step).blocks))
    assert list(batches_ahead(plan, 6, 6, torch.device("cpu"), 2)) == []


def test_steps_depend_on_seed_and_number_alone(datasets: list[Dataset]) -> None:
    corpus, _ = corpus_of(datasets)
    def planned(settings: TrainSettings) -> tuple[np.ndarray, Augmentation]:
        return rows_of_step(corpus, settings, VOXELS, 5), augmentation_of_step(settings, VOXELS, 5)

    (rows, augmentation), (again, same) = planned(SETTINGS), planned(SETTINGS)
    np.testing.assert_array_equal(rows, again)
    np.testing.assert_array_equal(augmentation.remap, same.remap)
    other = planned(replace(SETTINGS, seed=1))
    assert (rows != other[0]).any() and (augmentation.symmetry != other[1].symmetry).any()


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"threads": 1}, {"threads": 3}),
        *(
            pytest.param({"device": a}, {"device": b}, marks=GPU)
            for a, b in (("cpu", "cuda"), ("cuda", "cpu"), ("cuda", "cuda:0"))
        ),
    ],
)
def test_a_run_moves_to_another_device(datasets: list[Dataset], tmp_path: Path, first: dict, second: dict) -> None:
    """Begun on one and resumed on another, it goes as one that stayed on one CPU thread."""
    whole = tmp_path / "whole"
    drain(train(datasets, SETTINGS, RunOptions(whole, log_steps=1, threads=1)))
    moved = tmp_path / "moved"
    drain(train(datasets, SETTINGS, RunOptions(moved, log_steps=1, stop_after=3, **first)))
    weights = drain(train(datasets, SETTINGS, RunOptions(moved, log_steps=1, resume=True, **second)))
    np.testing.assert_allclose(curve(moved), curve(whole), rtol=ERRORS)
    assert len(curve(moved)) == 6 and weights.metadata["steps"] == 6
    assert all(np.isfinite(array).all() for array in weights.arrays().values())


@pytest.mark.parametrize("device", DEVICES)
def test_as_many_threads_go_on_exactly(datasets: list[Dataset], tmp_path: Path, device: str) -> None:
    """On a GPU to rounding: nothing there promises the same order of additions."""
    options = {"log_steps": 1, "threads": 3, "device": device}
    whole = drain(train(datasets, SETTINGS, RunOptions(tmp_path / "a", **options)))
    drain(train(datasets, SETTINGS, RunOptions(tmp_path / "b", stop_after=2, **options)))
    resumed = drain(train(datasets, SETTINGS, RunOptions(tmp_path / "b", resume=True, **options)))
    if device == "cpu":
        assert resumed.hash == whole.hash
    np.testing.assert_allclose(curve(tmp_path / "b"), curve(tmp_path / "a"), rtol=ERRORS)


@gpu_only
@pytest.mark.parametrize("precision", ["tf32", "bf16"])
def test_faster_products_learn_as_well(datasets: list[Dataset], tmp_path: Path, precision: str) -> None:
    settings = replace(SETTINGS, passes=60 * 256)
    for name in ("fp32", precision):
        options = RunOptions(tmp_path / name, log_steps=20, device="cuda")
        drain(train(datasets, replace(settings, precision=name), options))
    np.testing.assert_allclose(curve(tmp_path / precision), curve(tmp_path / "fp32"), rtol=0.15)


def test_types_of_products() -> None:
    assert encoder_type(replace(SETTINGS, precision="auto"), 0.5, "cuda:0") == torch.float32
    assert encoder_type(replace(SETTINGS, precision="tf32"), 0.5, "cuda:0") == torch.float32
    for device in ("cpu", "cuda:0"):
        assert encoder_type(replace(SETTINGS, precision="bf16"), 0.5, device) == torch.bfloat16
    with pytest.raises(SettingError, match="Precision 'fp8' is unknown: use one of auto, bf16, fp32, tf32"):
        replace(SETTINGS, precision="fp8")


def test_device_and_threads_of_the_command(
    datasets: list[Dataset], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = save_drawn(tmp_path, "a", datasets[0].octree, datasets[0].samples, SampleSettings())
    words = ["lab", "train", str(path), "--batch", "256", "--passes", "512", "--out", str(tmp_path / "run")]
    for device, sentence in (("gpu", "--device 'gpu' is unknown: choose auto"), ("cuda:777", "--device 'cuda:777'")):
        assert main([*words, "--device", device]) == 2
        assert sentence in capsys.readouterr().err
    assert main([*words, "--threads", "0"]) == 2
    assert "--threads 0 is outside 1 to" in capsys.readouterr().err
    assert main([*words, "--device", "cpu", "--threads", "3"]) == 0
    assert main([*words[:-1], str(tmp_path / "again"), "--device", "cpu", "--threads", "1"]) == 0
    np.testing.assert_allclose(curve(tmp_path / "run"), curve(tmp_path / "again"), rtol=ERRORS)
