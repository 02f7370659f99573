# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab validate`: errors of weights on samples."""

import json
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.kinds import MIXTURE, PAPER
from patchnet.patchnet_addon.network.weights import Weights, save_weights
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.references.lookups import node_at
from patchnet.tests.training.procedural import save_drawn, spheres_and_slats
from patchnet.training.commands import main
from patchnet.training.data.augmentation import Augmentation
from patchnet.training.data.dataset import load_dataset
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.run.validation import _errors, all_of, weights_errors


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = SampleSettings(views=4, min_level=3, held_out=0.3, seed=2)
    octree = spheres_and_slats(6, seed=4)
    samples = drain(draw_samples(octree, 600, settings))
    return save_drawn(tmp_path_factory.mktemp("errors"), "slats", octree, samples, settings)


@pytest.mark.parametrize("kind", [PAPER, MIXTURE])
def test_errors_are_means_over_the_views(file: Path, kind) -> None:
    dataset = load_dataset(file)
    found = weights_errors(Weights.random(3, kind=kind), dataset, 100)
    assert found["views"] == 400
    batch = all_of(dataset).batch(np.arange(100), Augmentation.none(100))
    node = [node_at(dataset.octree, int(one[0]), one[None, 1:].astype(int))[0] for one in dataset.samples.voxel[:100]]
    own = dataset.octree.luminance_float(np.array(node))[:, None]
    wanted = np.abs(own - batch.luminance)[batch.coverage > 0].mean()
    assert found["voxel_luminance"] == pytest.approx(wanted, abs=1e-5)
    ratio = found["luminance"] / found["voxel_luminance"]
    assert found["luminance_ratio"] == pytest.approx(ratio, rel=1e-3)


def test_command_compares_weights(file: Path, tmp_path: Path, capsys) -> None:
    save_weights(Weights.random(5, kind=MIXTURE), tmp_path / "new.safetensors")
    out = tmp_path / "made" / "errors.json"
    words = ["lab", "validate", str(file), "--weights", str(tmp_path / "new.safetensors"), "--voxels", "50"]
    words += ["--out", str(out)]
    assert main(words) == 0
    (found,) = json.loads(out.read_text())["errors"].values()
    assert found["scenes"]["slats"]["views"] == 200
    assert "slats" in capsys.readouterr().out
    assert main([*words[:2], str(file), *words[2:]]) == 2
    assert "Two sample files are called slats" in capsys.readouterr().err
    assert main(words) == 0  # its own file is replaced, something else is not
    out.write_text("notes")
    assert main(words) == 2 and out.read_text() == "notes"


def test_voxels_that_err_by_nothing_have_no_ratio() -> None:
    found = np.array([[1.0, 0.0], [0.5, 0.0], [0.5, 0.25], [0.75, 0.0], [0.5, 0.0]])  # of two views, one sees nothing
    errors = _errors(found)
    assert (errors["luminance"], errors["voxel_luminance"], errors["luminance_ratio"]) == (0.25, 0.0, None)
    assert _errors(found[:, 1:])["luminance"] == 0.0


def test_another_look_ahead_is_refused(file: Path) -> None:
    with pytest.raises(SettingError, match="slats looks 2 levels ahead, the weights 3: draw the samples"):
        weights_errors(Weights.random(lookahead=3), load_dataset(file), 10)
