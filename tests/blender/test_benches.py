# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet bench walkthrough`, `patchnet bench bake` and `patchnet bench preview`."""

import json
import math
from typing import Any

import numpy as np
import pytest

from patchnet.operators.render_engine.fly_through import frames_until_ahead
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.training.commands import main
from patchnet.training.commands.benches.walkthrough import walk_cameras

SMALL = ["--frames", "12", "--size", "48", "32", "--depth", "6", "--max-samples", "2", "--timed", "2"]
FEW = ["--cycles-timed", "1", "--judged", "1", "--error-size", "24", "16", "--truth", "64"]


def measured(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """What a bench prints, below lines of Blender's own, which `quiet_stdout` cannot divert from a test's capture."""
    assert main(["bench", *words]) == 0
    printed = capsys.readouterr().out
    return json.loads(printed[printed.index('{\n "name"') :])


def test_seconds_errors_and_flicker_of_all(capsys: pytest.CaptureFixture[str]) -> None:
    values = measured(capsys, "walkthrough", *SMALL, *FEW, "--cycles-samples", "32", "1")
    seconds = values["frames_s"]
    assert {name: len(each) for name, each in seconds.items()} == {"patchnet": 2, "1": 1, "32": 1}
    assert values["peer"] == seconds[str(values["rival_samples"])][0]
    assert values["ratio"] == pytest.approx(values["peer"] / values["ours"])
    setup = sum(values["setup_s"].values())
    assert set(values["setup_s"]) >= {"light", "voxelize"} and values["depth"] == 6
    assert values["total_s"]["patchnet"] == pytest.approx(setup + 12 * values["ours"])
    assert values["ahead_from"] == frames_until_ahead(setup, values["ours"], values["peer"])
    mse, flicker, moved = values["mse"], values["flicker"], values["moved"]
    assert 0.0 < mse["32"] < mse["1"] and mse["32"] < mse["patchnet"] < 0.1
    assert max(map(abs, flicker.values())) < 0.1 and len(set(flicker.values())) == 3
    assert all(0.0 < error < 0.1 for error in moved.values()) and len(set(moved.values())) == 3


def test_a_walk_passes_its_keys_without_a_halt() -> None:
    eyes = np.array([[0.0, -9.0, 3.0], [0.0, -6.0, 2.0], [1.0, -3.0, 1.5]])
    keys = [Camera.look_at(eye, np.zeros(3), fov=0.8, size_px=(64, 36)) for eye in eyes]
    cameras = walk_cameras(keys, 101, (64, 36))
    places = np.array([camera.position_world for camera in cameras])
    np.testing.assert_allclose(places[[0, 50, 100]], eyes, atol=1e-9)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.min() / steps.max() > 0.3 and len(cameras) == 101
    for camera, key in zip((cameras[0], cameras[50]), keys, strict=False):
        np.testing.assert_allclose(camera.forward, key.forward, atol=1e-6)
        assert math.isclose(camera.half_x, key.half_x, rel_tol=1e-6)


def test_rates_of_bake_and_renders(capsys: pytest.CaptureFixture[str]) -> None:
    values = measured(capsys, "bake", "--scene", "room", "--depth", "6", "--samples", "2")
    assert values["ours"] > 0 and values["peer"] > 0
    assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])
    assert sum(turn["paths"] for turn in values["calls"]) == values["samples"] * values["surfels"]
    for call, render in zip(values["calls"], values["renders"], strict=True):
        assert min(call["processor_s"], render["processor_s"]) > 0
        assert 0.8 < render["paths"] / call["paths"] < 1.25


def test_seconds_until_a_lit_picture(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["preview", "--scene", "room", "--camera", "Front", "--size", "64", "48", "--cycles-samples", "2"]
    values = measured(capsys, *words)
    assert 0.0 < values["ours"] <= values["whole_s"] and values["peer"] > 0.0
    assert values["noise"]["last"] <= values["noise"]["first"] and values["paths_per_pixel"] > 1.0
    assert values["camera"] == "Front" and values["size"] == [64, 48] and values["voxels"] > 1000
