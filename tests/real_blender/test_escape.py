# SPDX-License-Identifier: GPL-3.0-or-later
"""F12 in a job of Blender's own, stopped by Esc and started again; escape_window.py is what happened in the window."""

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


def test_renders_after_it_obey_masks_in_their_thread(seen: dict, out: Path) -> None:
    assert seen["image"] == seen["group"] == ["complete"]
    refined = single(out, "image", "Sample Count") == 1024
    half = refined.shape[1] // 2
    assert refined[:, :half].any() and not refined[:, half + 1 :].any()
    refined = single(out, "group", "Sample Count") == 1024
    assert 0.0 < refined.mean() < 0.5
    assert (single(out, "group", "Level")[refined] >= 0).mean() > 0.9  # the wall, and not the sky
