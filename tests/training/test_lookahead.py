# SPDX-License-Identifier: GPL-3.0-or-later
"""Training runs, sample files and commands for look-aheads of 1 and 3 levels."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training import commands
from patchnet.training.data.dataset import Dataset, load_dataset
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.settings import TrainSettings

torch = pytest.importorskip("torch")
from patchnet.training.run.trainer import RunOptions, train  # noqa: E402  needs torch

SETTINGS = TrainSettings(passes=2 * 64, batch=64, precision="fp32", augment=True)


@pytest.fixture(scope="module", params=[1, 3])
def dataset(request) -> Dataset:
    octree = spheres_and_slats(6, seed=5)
    settings = SampleSettings(views=4, min_level=2, held_out=0.0, seed=2, lookahead=request.param)
    samples = drain(draw_samples(octree, 128, settings))
    return Dataset("scene", octree, samples, {"settings": asdict(settings)})


def test_training_makes_weights_that_look_as_far_as_the_samples(dataset: Dataset, tmp_path: Path) -> None:
    weights = drain(train([dataset], SETTINGS, RunOptions(tmp_path)))
    assert weights.lookahead == dataset.lookahead == load_weights(tmp_path / "patchnet.safetensors").lookahead


@pytest.mark.parametrize("words", [[], ["--lookahead", "1"]])
def test_command_draws_samples_of_a_look_ahead(words: list[str], tmp_path: Path) -> None:
    octree = spheres_and_slats(6, seed=5)
    save_octree(octree, tmp_path / "o.safetensors")
    drawn = ["--samples", "64", "--views", "4", "--least-level", "2", "--held-out", "0", "--seed", "2"]
    out = ["--out", str(tmp_path / "samples")]
    assert commands.main(["lab", "dataset", str(tmp_path / "o.safetensors"), *drawn, *words, *out]) == 0
    (path,) = (tmp_path / "samples").iterdir()
    found, lookahead = load_dataset(path), 1 if words else 2
    settings = SampleSettings(views=4, min_level=2, held_out=0.0, seed=2, lookahead=lookahead)
    assert found.lookahead == lookahead
    np.testing.assert_array_equal(found.samples.views, drain(draw_samples(octree, 64, settings)).views)
