# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples, batches and training runs for look-aheads of 1 and 3 levels."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from patchnet import commands
from patchnet.patchnet_addon.codes.patch_rays import PatchRays, render_patches
from patchnet.patchnet_addon.codes.patches import OCTANTS
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.errors import FileFormatError, PatchNetError, SettingError
from patchnet.patchnet_addon.runtime.files import read_arrays, write_arrays
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.references.codes import corner_blocks_reference
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training.data.augmentation import COUNT, Augmentation, cube_symmetries
from patchnet.training.data.batches import gather_batch
from patchnet.training.data.corpus import corpus_of
from patchnet.training.data.dataset import Dataset, load_dataset, save_samples
from patchnet.training.data.forest import concatenate
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.settings import TrainSettings

torch = pytest.importorskip("torch")
from patchnet.training.run.model_card import write_card  # noqa: E402
from patchnet.training.run.trainer import RunOptions, train  # noqa: E402  needs torch

SETTINGS = TrainSettings(passes=2 * 64, batch=64, precision="fp32", augment=True)


@pytest.fixture(scope="module", params=[1, 3])
def dataset(request) -> Dataset:
    octree = spheres_and_slats(6, seed=5)
    settings = SampleSettings(views=4, min_level=2, held_out=0.0, seed=2, lookahead=request.param)
    samples = drain(draw_samples(octree, 128, settings))
    return Dataset("scene", octree, samples, {"settings": asdict(settings)})


def test_samples_are_what_rays_see(dataset: Dataset) -> None:
    samples, views = dataset.samples, dataset.samples.views.shape[1]
    signed = samples.views[..., 3:9].view(np.int16) / 32767.0
    rays = PatchRays(
        samples.voxel[:, 0].astype(np.int32), samples.voxel[:, 1:].astype(np.int32),
        np.arange(len(samples.voxel) + 1) * views, (samples.views[..., :3] / 65535.0).reshape(-1, 3),
        signed[..., :3].reshape(-1, 3), signed[..., 3:].reshape(-1, 3), (samples.views[..., 9] / 65535.0).ravel(),
    )  # fmt: skip
    coverage, luminance = render_patches(dataset.octree, rays, dataset.lookahead)
    np.testing.assert_allclose(coverage, samples.views[..., 10].ravel() / 4096, atol=3 / 4096)
    np.testing.assert_allclose(luminance, samples.views[..., 11].ravel() / 65535, atol=1e-3)
    assert samples.voxel[:, 0].max() <= dataset.octree.depth - dataset.lookahead


def test_patches_are_those_that_are_encoded(dataset: Dataset) -> None:
    count, side, samples = len(dataset.samples.voxel), 2**dataset.lookahead, dataset.samples
    trees = np.zeros(count, int)
    forest = concatenate([dataset.octree])
    none = Augmentation.none(count)
    batch = gather_batch(forest, trees, samples.voxel, samples.views, none, dataset.lookahead)
    eight = batch.blocks[batch.rows].reshape(count, 8, 2, 2, 2, side, side, side, 5)
    eight = eight.transpose(0, 1, 2, 5, 3, 6, 4, 7, 8)
    patches = eight.reshape(count, 8, 2 * side, 2 * side, 2 * side, 5)
    for row in range(0, count, 5):
        level, *cell = samples.voxel[row].astype(int)
        wanted = corner_blocks_reference(dataset.octree, level, np.array(cell) + OCTANTS, dataset.lookahead)
        np.testing.assert_allclose(patches[row], wanted, atol=1e-6)


@pytest.mark.parametrize("lookahead", [1, 3])
def test_symmetries_move_every_cell_once(lookahead: int) -> None:
    cell = cube_symmetries(lookahead).cell
    np.testing.assert_array_equal(np.sort(cell, axis=1), np.tile(np.arange(8**lookahead), (COUNT, 1)))


def test_training_makes_weights_that_look_as_far_as_the_samples(dataset: Dataset, tmp_path: Path) -> None:
    notes = {"command": "patchnet lab train", "machine": "m", "versions": "v"}
    options = RunOptions(tmp_path, notes=notes)
    weights = drain(train([dataset], SETTINGS, replace(options, stop_after=1)))
    assert weights.lookahead == dataset.lookahead == load_weights(tmp_path / "patchnet.safetensors").lookahead
    resumed = drain(train([dataset], SETTINGS, replace(options, resume=True)))
    assert resumed.metadata["steps"] == 2
    write_card(tmp_path, [dataset], SETTINGS, notes | {"sample_passes": 1, "steps": 1, "minutes": 1.0}, "h")
    assert f"Encoder {5 * (2 << dataset.lookahead) ** 3}-256" in (tmp_path / "model_card.md").read_text()


def test_look_aheads_are_not_mixed(dataset: Dataset, tmp_path: Path) -> None:
    settings = SampleSettings(views=4, min_level=2, held_out=0.0)
    other = Dataset("two", dataset.octree, drain(draw_samples(dataset.octree, 64, settings)), {})
    assert other.lookahead == 2  # as files that do not say
    with pytest.raises(SettingError, match="levels ahead: draw them with the same look-ahead"):
        corpus_of([dataset, other])
    drain(train([other], SETTINGS, RunOptions(tmp_path, stop_after=1)))
    with pytest.raises(SettingError, match="other values of"):
        drain(train([dataset], SETTINGS, RunOptions(tmp_path, resume=True)))


def test_sample_file_keeps_its_look_ahead(dataset: Dataset, tmp_path: Path) -> None:
    save_octree(dataset.octree, tmp_path / "o.safetensors")
    path = tmp_path / "s.samples.safetensors"
    settings = SampleSettings(lookahead=dataset.lookahead)
    save_samples(dataset.samples, tmp_path / "o.safetensors", dataset.octree, settings, path)
    assert load_dataset(path).lookahead == dataset.lookahead
    arrays, metadata = read_arrays(path, "samples")
    write_arrays(path, arrays, metadata | {"settings": {"lookahead": 4}}, "samples")
    with pytest.raises(FileFormatError, match="looks 4 levels ahead"):
        load_dataset(path)


def test_octree_that_is_not_deep_enough(dataset: Dataset) -> None:
    settings = SampleSettings(min_level=7 - dataset.lookahead, lookahead=dataset.lookahead)
    with pytest.raises(PatchNetError, match="use one of depth 7 or more"):
        drain(draw_samples(dataset.octree, 10, settings))


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


def test_command_refuses_other_look_aheads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert commands.main(["lab", "dataset", "o.safetensors", "--lookahead", "4", "--out", str(tmp_path)]) == 2
    assert "--lookahead 4 is outside" in capsys.readouterr().err
