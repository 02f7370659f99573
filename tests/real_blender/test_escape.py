# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of escape_window.py: Esc during F12, and a render after it."""

from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.tests.real_blender.executable import PATIENCE_S, Blender


@pytest.fixture(scope="module")
def seen(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of escape_window.py."""
    return installed.visit("escape", out, file=courtyard, simulate=False)


def single(out: Path, name: str, layer_pass: str) -> np.ndarray:
    """A pass (H, W) of a render."""
    return read_exr(out / f"escape-{name}.exr")[f"ViewLayer.{layer_pass}.X"]


def test_escape_stops_a_render(seen: dict) -> None:
    assert seen["stopped"]["ended"] == ["cancel"]
    assert seen["stopped"]["seconds"] < PATIENCE_S


def test_what_was_refined_by_then_stays(seen: dict, out: Path) -> None:
    samples = single(out, "stopped", "Sample Count")
    assert np.array_equal(samples, np.load(out / "escape-samples.npy"))
    assert 0.0 < (samples == 1024).mean() < 0.9 and set(np.unique(samples)) == {1.0, 1024.0}
    assert read_exr(out / "escape-stopped.exr")["ViewLayer.Combined.G"].std() > 0.01


def test_a_render_after_it_obeys_a_mask_in_its_thread(seen: dict, out: Path) -> None:
    assert seen["image"] == ["complete"]
    refined = single(out, "image", "Sample Count") == 1024
    half = refined.shape[1] // 2
    assert refined[:, :half].any() and not refined[:, half + 1 :].any()
