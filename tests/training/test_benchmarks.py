# SPDX-License-Identifier: GPL-3.0-or-later
"""Benches without Blender: printed values and errors."""

import importlib.util
import json
import sys

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.runtime.errors import PatchNetError
from patchnet.tests.engine.octree_samples import random_octree, with_boxes, with_sides
from patchnet.training.benchmarks.shells import octree_of_shells
from patchnet.training.commands import main
from patchnet.training.commands.benches.egl_device import EglDevice
from patchnet.training.commands.benches.frame import STAGES

HAS_TORCH = importlib.util.find_spec("torch") is not None
ENCODE = ["encode", "--nodes", "3000", "--repeats", "2"]
DECODE = ["decode", "--nodes", "30000", "--pixels", "3000", "--repeats", "2"]


def measured(capsys, *words):
    """What a bench prints."""
    assert main(["bench", *map(str, words)]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["trace", "--scene", "none.glb"], "Embree cannot be imported"),
        (["encode", "shallow.safetensors"], "no corners to encode"),
        (["decode", "shallow.safetensors"], "No pixel around this octree has look-ahead"),
    ],
)
def test_what_cannot_be_measured_is_explained(words, said, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "embreex", None)
    save_octree(random_octree(depth=1, count=5), tmp_path / "shallow.safetensors")
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("count", [500, 130_000])
def test_shells_have_the_nodes_that_were_asked_for(count, tmp_path):
    octree = octree_of_shells(count)
    assert count <= octree.node_count < count * (4.5 if count < 100_000 else 1.06)
    save_octree(octree, tmp_path / "shells.safetensors")
    assert load_octree(tmp_path / "shells.safetensors").node_count == octree.node_count  # consistent
    assert len(np.unique(octree.luminance)) > 100


def test_both_encoders_make_the_same_codes(capsys):
    values = measured(capsys, *ENCODE, "--threads", 1)
    assert (values["name"], values["unit"], values["octree"]) == ("encode", "corners per second", "shells")
    assert values["nodes"] >= 3000 and values["corners"] > 100
    names = {"compiled"} | ({"torch"} if HAS_TORCH else set())
    assert values["corners_per_s"].keys() == values["runs"].keys() == names
    assert (values["threads"], values["clock"]) == (1, "processor")
    assert values["largest_difference"] <= 1e-3 * values["largest_code"]  # half floats differ in their last bit
    if HAS_TORCH:
        assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])


def test_all_rates_of_the_decoder(capsys):
    values = measured(capsys, *DECODE, "--threads", 2)
    assert (values["name"], values["unit"], values["octree"]) == ("decode", "pixels per second", "shells")
    assert values["nodes"] >= 30000 and values["pixels"] >= values["decoded_pixels"] >= 3000
    names = {"decode", "trace"} | ({"torch"} if HAS_TORCH else set())
    assert values["pixels_per_s"].keys() == values["runs"].keys() == names
    assert all(len(runs) == 2 for runs in values["runs"].values())
    assert (values["threads"], values["clock"]) == (2, "wall")
    if HAS_TORCH:
        assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])


def test_tracing_without_a_peer_and_frames_by_stage(tmp_path, capsys):
    path = tmp_path / "random.safetensors"
    save_octree(random_octree(depth=6, count=300), path)
    small = ["--size", 32, 24, "--repeats", 1]
    values = measured(capsys, "trace", path, *small)
    assert values["name"] == "trace" and values["peer"] is None and len(values["views"]) == 3
    assert all(rate > 0 for view in values["views"] for rate in view["rays_per_s"].values())
    values = measured(capsys, "frame", path, *small)
    assert len(values["frames"]) == 3 and values["depth"] == 6
    for frame in values["frames"]:
        assert frame["ours"] == pytest.approx(sum(frame["stage_s"][stage] for stage in STAGES)) and frame["peer"] > 0


def test_a_graphics_card_agrees_with_the_kernels(tmp_path, capsys):
    pytest.importorskip("moderngl")
    try:
        EglDevice()
    except PatchNetError as reason:
        pytest.skip(str(reason))
    octree = with_sides(with_boxes(octree_of_shells(100_000)))
    save_octree(octree, tmp_path / "shells.safetensors")
    values = measured(capsys, "gpu", tmp_path / "shells.safetensors", "--size", 64, 48, "--repeats", 1)
    views = {view["name"]: view for view in values["views"]}
    assert set(views) == {"Far", "Inside", "Close", "Around"} and values["upload_s"] > 0 and values["compile_s"] > 0
    for view in views.values():
        assert view["same_nodes"] >= 0.9999 and view["card"]["trace"] > 0 and view["cpu"]["trace"] > 0
    around = views["Around"]
    assert around["coverage"] < 5e-4 and around["luminance"] < 2e-3 and around["order"] >= 0.999
