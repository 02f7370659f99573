# SPDX-License-Identifier: GPL-3.0-or-later
"""Failures of a network: the worst square is the worst of all, and the command draws it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.codes.coded_octree import CodedOctree
from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training.evaluation.failures import worst_failure
from patchnet.training.evaluation.tracks import camera_track

SIDE = 24


@pytest.fixture(scope="module")
def coded() -> CodedOctree:
    return drain(encode_octree(spheres_and_slats(7, seed=2), load_weights()))


@pytest.fixture(scope="module")
def cameras(coded: CodedOctree) -> dict[int, Camera]:
    return dict(enumerate(drain(camera_track(coded.octree, frames=3, size_px=(64, 48)))))


def test_worst_square_is_the_worst_of_all_frames(coded: CodedOctree, cameras: dict[int, Camera]) -> None:
    found = drain(worst_failure(coded, "slats", cameras))
    totals, known = {}, 0
    for frame, camera in cameras.items():
        buffers = drain(worst_failure(coded, "slats", {frame: camera})).buffers
        ours, exact = buffers.prediction, buffers.exact
        squared = np.where(ours.look_ahead, ours.coverage * ours.luminance - exact.coverage * exact.luminance, 0) ** 2
        picture, known = buffers.picture(squared), known + int(ours.look_ahead.sum())
        squares = np.lib.stride_tricks.sliding_window_view(picture, (SIDE, SIDE))
        totals[frame] = squares.mean(axis=(2, 3)), picture.sum()
    worst = max(totals, key=lambda frame: totals[frame][0].max())
    assert found.frame == worst
    assert found.squared == pytest.approx(totals[worst][0].max(), rel=1e-4)
    assert totals[worst][0][found.crop.row, found.crop.column] == pytest.approx(found.squared, rel=1e-4)
    assert found.of_all == pytest.approx(sum(total for _, total in totals.values()) / known, rel=1e-4)
    assert found.of_all > 0


def test_no_failure_where_the_network_says_what_the_patch_shows(
    coded: CodedOctree, cameras: dict[int, Camera], monkeypatch: pytest.MonkeyPatch
) -> None:
    from patchnet.training.evaluation import failures

    trace = failures.trace_view

    def all_knowing(*args, **options):  # type: ignore[no-untyped-def]
        buffers = yield from trace(*args, **options)
        return replace(buffers, prediction=replace(buffers.exact, look_ahead=buffers.prediction.look_ahead))

    monkeypatch.setattr(failures, "trace_view", all_knowing)
    assert drain(worst_failure(coded, "slats", cameras)).squared == 0


def test_command_draws_a_row_for_each_octree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    octree = tmp_path / "slats.safetensors"
    save_octree(spheres_and_slats(6, seed=2), octree)
    assert main(["lab", "figures", str(octree), "--every", "1000", "--out", str(tmp_path / "out")]) == 0
    assert "failures.png" in capsys.readouterr().out
    assert (tmp_path / "out/failures.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["lab", "figures", str(octree), "--only", "split", "--out", str(tmp_path / "out")]) == 2
    assert "leave out --only" in capsys.readouterr().err
