# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples that `patchnet lab dataset` draws for a look-ahead."""

from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training import commands
from patchnet.training.data.dataset import load_dataset
from patchnet.training.data.samples import SampleSettings, draw_samples


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
