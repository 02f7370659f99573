# SPDX-License-Identifier: GPL-3.0-or-later
"""Held-out scenes: reasons for exclusion, reports, baselines."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.weights import Weights, load_weights
from patchnet.patchnet_addon.octree.file import octree_hash
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.training.procedural import save_drawn, spheres_and_slats
from patchnet.training import commands
from patchnet.training.data.dataset import Dataset, why_not_held_out
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.run.run_files import read_log
from patchnet.training.run.validation import validation_sets

pytest.importorskip("torch")
from patchnet.training.data.augmentation import Augmentation
from patchnet.training.data.corpus import corpus_of
from patchnet.training.network.patchnet import PatchNet
from patchnet.training.run.validation import validate

SETTINGS = SampleSettings(views=4, min_level=5, held_out=0.2)  # patches of level 5 fit into held-out blocks


def dataset_of(name: str, seed: int = 1, **provenance: object) -> Dataset:
    octree = replace(spheres_and_slats(7, seed=seed), provenance=provenance)
    return Dataset(name, octree, drain(draw_samples(octree, 400, SETTINGS)), {})


@pytest.fixture(scope="module")
def upright() -> Dataset:
    return dataset_of("sponza", file="Sponza.glb", rotation=0)


@pytest.fixture(scope="module")
def turned() -> Dataset:
    return dataset_of("sponza-turned", file="Sponza.glb", rotation=1)


@pytest.fixture(scope="module")
def other() -> Dataset:
    return dataset_of("yard", seed=2, file="yard.glb", rotation=0)


def test_scene_that_is_not_in_training_is_held_out(upright: Dataset, turned: Dataset, other: Dataset) -> None:
    assert why_not_held_out(other, [upright, turned]) == ""
    assert why_not_held_out(upright, [other]) == ""


def test_turned_scene_is_not_held_out(upright: Dataset, turned: Dataset, other: Dataset) -> None:
    for dataset, training in ((upright, [other, turned]), (turned, [upright]), (upright, [upright])):
        assert why_not_held_out(dataset, training) == "not held out: Sponza.glb is in training"


@pytest.mark.parametrize("changes", [{"file": "sponza.blend"}, {"light": "cycles"}, {"without": "roof"}])
def test_other_format_light_or_part_is_the_same_scene(upright: Dataset, changes: dict[str, str]) -> None:
    again = replace(upright, octree=replace(upright.octree, provenance=upright.octree.provenance | changes))
    assert why_not_held_out(again, [upright]).startswith("not held out")


def test_unknown_scene_is_never_held_out(upright: Dataset, other: Dataset) -> None:
    unknown = replace(other, name="old", octree=replace(other.octree, provenance={}))
    assert "does not say its scene" in why_not_held_out(unknown, [upright])
    assert why_not_held_out(upright, [other, unknown]) == (
        "not held out: the octree of old in training does not say its scene, which may be Sponza.glb"
    )


def test_sets_of_a_run(upright: Dataset, turned: Dataset, other: Dataset) -> None:
    """Held-out parts of training scenes are there, but are not counted as held-out scenes."""
    corpus, parts = corpus_of([upright])
    sets = validation_sets(parts, [upright], [turned, other], corpus.lookahead)
    assert {name for name, each in sets.items() if not each.not_held_out} == {"yard"}
    assert sets["sponza"].not_held_out == "not held out: Sponza.glb is in training"
    assert len(sets["yard"].corpus.tree) == len(other.samples.voxel)
    with pytest.raises(SettingError, match="called sponza"):
        validation_sets(parts, [upright], [upright], corpus.lookahead)
    with pytest.raises(SettingError, match="training 3"):
        validation_sets(parts, [upright], [other], 3)


def test_errors_stand_beside_those_of_guesses(upright: Dataset) -> None:
    """Those of the guesses from the samples themselves, with untrained weights."""
    corpus, _ = corpus_of([upright])
    errors = validate(PatchNet(Weights.random(0)), corpus)
    coverage, luminance = corpus.views[..., 10] / 4096, corpus.views[..., 11] / 65535
    seen = coverage > 0
    own = corpus.batch(np.arange(len(seen)), Augmentation.none(len(seen))).own[:, None]
    wanted = {
        "constant_coverage": np.abs(coverage - np.median(coverage)).mean(),
        "constant_luminance": np.abs(luminance[seen] - np.median(luminance[seen])).mean(),
        "voxel_luminance": np.abs(own - luminance)[seen].mean(),
    }
    for name, value in wanted.items():
        assert errors[name] == pytest.approx(value, abs=1e-5)
    assert errors["voxel_luminance"] < errors["constant_luminance"] < errors["luminance"]


def test_train_records_and_reports(
    upright: Dataset,
    turned: Dataset,
    other: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Log and weights of a run that validates on an unseen scene and on a turned one of training."""
    files = {
        each.name: save_drawn(tmp_path, each.name, each.octree, each.samples, SETTINGS)
        for each in (upright, turned, other)
    }
    out = tmp_path / "run"
    words = ["lab", "train", str(files["sponza"]), "--validate", str(files["sponza-turned"]), str(files["yard"])]
    words += ["--passes", "128", "--batch", "64", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["patchnet", *words])
    assert commands.main(words) == 0
    assert "sponza-turned is not held out: Sponza.glb is in training" in capsys.readouterr().err
    assert set(read_log(out / "log.jsonl")[1][-1]["not_held_out"]) == {"sponza", "sponza-turned"}
    metadata = load_weights(out / "patchnet.safetensors").metadata
    assert metadata["octrees"] == {"sponza": octree_hash(upright.octree)}
    assert metadata["validation_octrees"]["yard"] == octree_hash(other.octree)
    assert len(metadata["code"]) == 16 and "commit" in metadata
