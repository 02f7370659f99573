# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks of tracing and of frames: what they print."""

import json

import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.training.benchmarks.frames import STAGES

SMALL = ["--size", "32", "24", "--repeats", "1"]


@pytest.fixture(scope="module")
def octree_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("octree") / "random.safetensors"
    save_octree(random_octree(depth=6, count=300), path)
    return path


def last_line(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_tracing_without_a_peer(octree_file, capsys):
    assert main(["bench", "trace", str(octree_file), *SMALL, "--json"]) == 0
    values = last_line(capsys)
    assert values["name"] == "trace" and values["peer"] is None and len(values["views"]) == 3
    assert all(rate > 0 for view in values["views"] for rate in view["rays_per_s"].values())


def test_frames_by_stage(octree_file, capsys):
    assert main(["bench", "frame", str(octree_file), *SMALL, "--json"]) == 0
    values = last_line(capsys)
    assert len(values["frames"]) == 3 and values["depth"] == 6
    for frame in values["frames"]:
        assert frame["ours"] == pytest.approx(sum(frame["stage_s"][stage] for stage in STAGES)) and frame["peer"] > 0
