# SPDX-License-Identifier: GPL-3.0-or-later
"""Benches without Blender: what they print, that both sides work on the same input, and what a missing peer says."""

import importlib.util
import json
import sys

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.commands.benches import gpu, train, voxelize
from patchnet.commands.benches.egl_device import EglDevice
from patchnet.commands.benches.frame import STAGES
from patchnet.patchnet_addon.network.kinds import PAPER
from patchnet.patchnet_addon.network.weights import Weights, save_weights
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.runtime.errors import PatchNetError, SettingError
from patchnet.tests.engine.octree_samples import random_octree, with_boxes, with_sides
from patchnet.tests.torch_devices import DEVICES
from patchnet.training.benchmarks.shells import octree_of_shells
from patchnet.training.benchmarks.timing import timed

CORNERS = np.random.default_rng(0).uniform(0, 1, (50, 3, 3))
HAS_TORCH = importlib.util.find_spec("torch") is not None
ENCODE = ["encode", "--nodes", "3000", "--repeats", "2"]
DECODE = ["decode", "--nodes", "30000", "--pixels", "3000", "--repeats", "2"]


def measured(capsys, *words):
    """What a bench prints as JSON."""
    assert main(["bench", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def shown(capsys, *words):
    assert main(["bench", *map(str, words)]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("threads", [1, 2])
def test_voxelizers_get_the_same_triangles_and_voxel_size(threads, peer, monkeypatch, capsys):
    monkeypatch.setattr(voxelize, "read_triangles", lambda scene: CORNERS)
    words = ["voxelize", "--scene", "a/soup.glb", "--depth", 5, "--repeats", 2, "--threads", threads]
    values = measured(capsys, *words)
    assert len(peer.meshes) == 3  # the first is a rehearsal
    np.testing.assert_array_equal(peer.meshes[1], CORNERS)
    assert peer.sides[1] == pytest.approx(np.ptp(CORNERS.reshape(-1, 3), axis=0).max() / 32, rel=1e-4)
    assert (values["name"], values["unit"], values["scene"], values["depth"]) == ("voxelize", "s", "soup.glb", 5)
    assert values["peer_voxels"] == 7 and values["ours_voxels"] > 1000
    assert values["clock"] == {1: "processor", 2: "wall"}[threads]
    assert values["ratio"] == pytest.approx(values["peer"] / values["ours"])
    assert "soup.glb at depth 5: octree of" in shown(capsys, *words)


def test_open3d_itself():
    try:
        voxelize.import_open3d()
    except PatchNetError as reason:
        pytest.skip(str(reason))
    square = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    voxels = voxelize.Open3DVoxels(square)
    voxels.voxelize(0.1)
    assert voxels.voxel_count == len(voxels._voxels.get_voxels()) >= 100
    assert voxels.name.startswith("Open3D 0.")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["voxelize", "--scene", "soup.glb", "--repeats", "0"], "--repeats 0 is outside 1 to"),
        (["decode", "--pixels", "0"], "--pixels 0 is outside 1 to"),
        (["train", "--device", "cuda:777"], "--device 'cuda:777'"),
        (["trace", "--scene", "none.glb"], "Embree cannot be imported"),
        (["encode", "shallow.safetensors"], "no corners to encode"),
        (["decode", "shallow.safetensors"], "no pixel has look-ahead"),
    ],
)
def test_what_cannot_be_measured_is_explained(words, said, peer, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "embreex", None)
    save_octree(random_octree(depth=1, count=5), tmp_path / "shallow.safetensors")
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *words]) == 2
    assert said in capsys.readouterr().err


def test_a_missing_peer_is_explained(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(PatchNetError, match=r"Open3D cannot be imported .* install patchnet-blender\[peers\]"):
        voxelize.import_open3d()


def test_the_median_run_counts_and_both_take_turns():
    order = []
    runs = {"ours": lambda: order.append("ours"), "peer": lambda: order.append("peer")}
    seconds, details = timed(runs, 3)
    assert order == ["ours", "peer"] * 3
    assert seconds["ours"] == pytest.approx(sorted(details["runs"]["ours"])[1], abs=1e-4)


@pytest.mark.parametrize("count", [500, 130_000, 200_000])
def test_shells_have_the_nodes_that_were_asked_for(count, tmp_path):
    octree = octree_of_shells(count)
    assert count <= octree.node_count < count * (4.5 if count < 100_000 else 1.06)
    save_octree(octree, tmp_path / "shells.safetensors")
    assert load_octree(tmp_path / "shells.safetensors").node_count == octree.node_count  # consistent
    assert len(np.unique(octree.luminance)) > 100


@pytest.mark.parametrize("count", [0, 1 << 40])
def test_impossible_numbers_of_nodes(count):
    with pytest.raises(SettingError, match="--nodes"):
        octree_of_shells(count)


@pytest.mark.parametrize("threads", [1, 2])
def test_both_encoders_make_the_same_codes(threads, capsys):
    values = measured(capsys, *ENCODE, "--threads", threads)
    assert (values["name"], values["unit"], values["octree"]) == ("encode", "corners per second", "shells")
    assert values["nodes"] >= 3000 and values["corners"] > 100
    names = {"compiled"} | ({"torch"} if HAS_TORCH else set())
    assert values["corners_per_s"].keys() == values["runs"].keys() == names
    assert (values["threads"], values["clock"]) == (threads, "processor" if threads == 1 else "wall")
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
        assert values["torch"].startswith("torch ")


def test_other_weights_decode_in_words(tmp_path, capsys):
    save_weights(Weights.random(1, kind=PAPER), tmp_path / "paper.safetensors")
    said = shown(capsys, *DECODE, "--weights", tmp_path / "paper.safetensors")
    assert "threads: 1, processor seconds" in said and "network: paper" in said
    assert "| ours, whole decode | " in said and "| tracing the same pixels | " in said


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
    assert "| Around | " in gpu.text(values)


@pytest.mark.skipif(not HAS_TORCH, reason="no torch here")
@pytest.mark.parametrize("device", DEVICES)
def test_both_kinds_of_network_are_trained(capsys, device: str) -> None:
    words = ["train", "--nodes", 60000, "--samples", 20000, "--repeats", 1, "--threads", 2]
    values = measured(capsys, *words, "--precision", "fp32", "--encoder-width", 64, "--device", device)
    assert (values["name"], values["unit"], values["threads"]) == ("train", "samples per second", 2)
    rows, devices = values["rows"], 2 if device == "cuda" else 1
    assert [row["kind"] for row in rows] == ["mixture"] * devices + ["paper"] * devices
    for row in rows:
        assert row["samples_per_s"] == pytest.approx(1e3 * row["batch"] / row["step_ms"])
        assert row["samples_per_processor_s"] > 0 and row["batch"] in (2048, 8192)
        assert row["precision"] == "float32"
    assert values["ours"] == rows[0]["samples_per_s"]
    assert values["peer"] == (rows[1]["samples_per_s"] if device == "cuda" else None)
    assert f"| mixture | {rows[0]['device']} | 2,048 | {rows[0]['precision']} | " in train.text(values)
