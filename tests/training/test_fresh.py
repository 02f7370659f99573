# SPDX-License-Identifier: GPL-3.0-or-later
"""Fresh samples: drawn views, held-out parts, the command."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.file import octree_hash, save_octree
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.tests.training.test_batches import assert_seen
from patchnet.training.commands import main
from patchnet.training.data.corpus import FreshCorpus, fresh_corpus_of
from patchnet.training.data.dataset import Dataset
from patchnet.training.data.samples import Samples, SampleSettings
from patchnet.training.data.voxel_choice import held_out_voxels
from patchnet.training.run.run_files import read_log

torch = pytest.importorskip("torch")


DRAWN = 2000


def dataset(seed: int) -> Dataset:
    settings = SampleSettings(views=4, min_level=3, held_out=0.2, seed=seed)
    none = Samples(np.zeros((0, 4), np.uint16), np.zeros(0, bool), np.zeros((0, 4, 12), np.uint16))
    return Dataset(f"scene {seed}", spheres_and_slats(7, seed=seed), none, {"settings": asdict(settings)})


@pytest.fixture(scope="module")
def datasets() -> list[Dataset]:
    return [dataset(1), dataset(2)]


@pytest.fixture(scope="module")
def corpus(datasets: list[Dataset]) -> FreshCorpus:
    return fresh_corpus_of(datasets)[0]


def test_views_are_what_rays_see(datasets: list[Dataset], corpus: FreshCorpus) -> None:
    tree, voxel, views = corpus.draw(0, 7, slice(0, 100))
    for number, each in enumerate(datasets):
        here = np.flatnonzero(tree == number)
        assert_seen(each.octree, voxel[here], views[here])


def test_what_is_drawn_is_that_of_seed_step_and_place(corpus: FreshCorpus) -> None:
    whole = corpus.draw(0, 3, slice(0, 64))
    parts = [corpus.draw(0, 3, part) for part in (slice(0, 10), slice(10, 64))]
    for one, two, three in zip(whole, *parts, strict=True):
        np.testing.assert_array_equal(one, np.concatenate([two, three]))
    for other in (corpus.draw(0, 4, slice(0, 64)), corpus.draw(1, 3, slice(0, 64))):
        assert (other[2] != whole[2]).any(axis=(1, 2)).all()


def test_held_out_parts_stay_out(datasets: list[Dataset], corpus: FreshCorpus) -> None:
    """They are those of `patchnet lab dataset`, and validation is on them alone."""
    tree, voxel, _ = corpus.draw(0, 1, slice(0, DRAWN))
    _, held_out = fresh_corpus_of(datasets)
    assert list(held_out) == ["scene 1", "scene 2"]
    for number, each in enumerate(datasets):
        settings = each.sample_settings
        assert held_out_voxels(each.octree, voxel[tree == number], settings.held_out, settings.seed)[0].all()
        inside = held_out[each.name].voxel
        assert held_out_voxels(each.octree, inside, settings.held_out, settings.seed)[1].all() and len(inside) == 2048


def test_command(datasets: list[Dataset], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "slats.safetensors", tmp_path / "run"
    octree = replace(spheres_and_slats(8, seed=3), provenance={"file": "slats.blend", "light": "two-lights"})
    save_octree(octree, path)
    words = ["lab", "train", str(path), "--fresh", "--out", str(out), "--batch", "256", "--threads", "1"]
    words += ["--device", "cpu"]
    assert main([*words, "--passes", "1024"]) == 0
    weights = load_weights(out / "patchnet.safetensors")
    assert weights.metadata["settings"]["fresh"] and weights.metadata["octrees"] == {"slats": octree_hash(octree)}
    curve, validations = read_log(out / "log.jsonl")
    last = validations[-1]
    assert "slats.blend is in training" in last["not_held_out"]["slats"]
    said = capsys.readouterr().out
    for name, errors in (("learned from", curve[-1]), ("slats", last["validation"]["slats"])):
        assert f"  {name:<24} {errors['coverage']:.4f} {errors['luminance']:.4f}" in said
    assert f"{out} holds patchnet.safetensors, log.jsonl, checkpoint.pt" in said
