# SPDX-License-Identifier: GPL-3.0-or-later
"""Training on devices and any number of threads: equal steps to rounding, runs that change devices."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.kinds import MIXTURE
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.torch_devices import GPU, gpu_only
from patchnet.tests.training.procedural import two_datasets
from patchnet.training.data.corpus import corpus_of
from patchnet.training.data.dataset import Dataset
from patchnet.training.run.run_files import read_log
from patchnet.training.settings import SQUARED, TrainSettings

torch = pytest.importorskip("torch")
from patchnet.training.data.tensor_batch import tensor_batch  # noqa: E402  needs torch
from patchnet.training.run.learner import Learner  # noqa: E402  needs torch
from patchnet.training.run.steps import StepPlan, batches_ahead  # noqa: E402
from patchnet.training.run.trainer import RunOptions, train  # noqa: E402  needs torch

SETTINGS = TrainSettings(passes=6 * 256, batch=256, precision="fp32", augment=True, average=0.9, clip=1.0, warm_up=2)
VOXELS = 64
GRADIENTS = 5e-3  # of the norm: on a GPU a ReLU's input may round to the other side of zero
ERRORS = 1e-3  # relative, of the curves of a short run


MIXING = replace(SETTINGS, network=MIXTURE.name, loss=SQUARED)


@pytest.fixture(scope="module")
def datasets() -> list[Dataset]:
    return two_datasets(2)


def curve(folder: Path) -> np.ndarray:
    """Coverage and luminance errors (n, 2) of a log."""
    return np.array([(line["coverage"], line["luminance"]) for line in read_log(folder / "log.jsonl")[0]])


@pytest.mark.parametrize("encoder", ["mlp", "conv3d"])
@pytest.mark.parametrize("settings", [SETTINGS, MIXING], ids=["paper", "mixture"])
@pytest.mark.parametrize("lookahead", [1, 2, 3])
@gpu_only
def test_a_gpu_says_and_learns_the_same(lookahead: int, settings: TrainSettings, encoder: str) -> None:
    settings = replace(settings, encoder=encoder, encoder_width=0)
    corpus, _ = corpus_of(two_datasets(2, lookahead), nearby=settings.kind.mixes)
    plan = StepPlan(corpus, settings, VOXELS)
    there, here = Learner(settings, lookahead, "cuda"), Learner(settings, lookahead)
    ahead = batches_ahead(plan, 0, 3, there.device, 3)
    for step, batch in enumerate(ahead):
        wanted, errors = here.differentiate(tensor_batch(plan.batch(step)), torch.float32)
        gradients, found = there.differentiate(batch, torch.float32)
        torch.testing.assert_close(found.cpu(), errors, rtol=1e-5, atol=1e-6)
        for mine, theirs in zip(wanted, gradients, strict=True):
            assert (theirs.cpu() - mine).norm() <= GRADIENTS * mine.norm()


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


@gpu_only
@pytest.mark.parametrize("precision", ["tf32", "bf16"])
def test_faster_products_learn_as_well(datasets: list[Dataset], tmp_path: Path, precision: str) -> None:
    settings = replace(SETTINGS, passes=60 * 256)
    for name in ("fp32", precision):
        options = RunOptions(tmp_path / name, log_steps=20, device="cuda")
        drain(train(datasets, replace(settings, precision=name), options))
    np.testing.assert_allclose(curve(tmp_path / precision), curve(tmp_path / "fp32"), rtol=0.15)
