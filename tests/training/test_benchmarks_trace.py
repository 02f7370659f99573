# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks of tracing, of frames and of first use: what they print and draw."""

import json
import sys

import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.errors import PatchNetError
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.training.benchmarks import first_use, tracing_growth
from patchnet.training.benchmarks.frames import STAGES

SMALL = ["--size", "32", "24", "--repeats", "1"]


@pytest.fixture(scope="module")
def octree_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("octree") / "random.safetensors"
    save_octree(random_octree(depth=6, count=300), path)
    return path


def last_line(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_tracing_without_a_peer_and_its_growth(octree_file, tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(tracing_growth, "_WIDTHS", (8, 16))
    monkeypatch.setattr(tracing_growth, "_LEAST_PIXELS", 500)
    figure = tmp_path / "growth.svg"
    assert main(["bench", "trace", str(octree_file), *SMALL, "--plot", str(figure), "--json"]) == 0
    values = last_line(capsys)
    assert values["name"] == "trace" and values["peer"] is None and len(values["views"]) == 3
    assert all(rate > 0 for view in values["views"] for rate in view["rays_per_s"].values())
    growth = values["growth"]
    assert growth["depth"]["x"] == [5, 6] and growth["width_px"]["x"] == [8, 16] and growth["threads"]["x"][0] == 1
    for rates in growth.values():
        assert len(rates) == 4 and all(len(row) == len(rates["x"]) and min(row) > 0 for row in rates.values())
    assert "depth of the octree" in figure.read_text(encoding="utf-8")


def test_a_figure_that_cannot_be_drawn_is_refused_before_tracing(octree_file, tmp_path, capsys):
    assert main(["bench", "trace", str(octree_file), "--plot", str(tmp_path / "growth.bmp")]) == 2
    assert "unknown extension" in capsys.readouterr().err


def test_frames_by_stage(octree_file, capsys):
    assert main(["bench", "frame", str(octree_file), *SMALL, "--json"]) == 0
    values = last_line(capsys)
    assert len(values["frames"]) == 3 and values["depth"] == 6
    for frame in values["frames"]:
        assert frame["ours"] == pytest.approx(sum(frame["stage_s"][stage] for stage in STAGES)) and frame["peer"] > 0


@pytest.mark.skipif(sys.platform == "win32", reason="no wait4")
def test_a_step_is_run_twice_with_kernels_of_its_own(tmp_path):
    step = first_use._step(["--help"], tmp_path)
    assert step.first_s > 0 and step.second_processor_s > 0
    with pytest.raises(PatchNetError, match="`patchnet info` ended with code"):
        first_use._step(["info", str(tmp_path / "missing.safetensors")], tmp_path)
