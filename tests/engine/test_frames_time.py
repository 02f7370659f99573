# SPDX-License-Identifier: GPL-3.0-or-later
"""Share of an animation that is done and seconds left, with a clock that the test sets."""

import time

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime import compiling
from patchnet.patchnet_addon.runtime.frames_time import FramesTime
from patchnet.patchnet_addon.runtime.progress import Progress
from patchnet.tests.engine.test_job_time import Clock


def seen(seconds: list[float], own: bool, expected: int | None = None) -> tuple[list[Progress], np.ndarray]:
    """Reports of frames that take `seconds`, ten each, and the seconds really left; own: frames say theirs."""
    clock = Clock()
    frames, found, left = FramesTime(len(seconds) if expected is None else expected, clock), [], []
    for at, length in enumerate(seconds):
        frames.begin()
        for step in range(10):
            rest = length * (1 - step / 10)
            found.append(frames.see(Progress(step, 10, "step", left_s=rest if own else None)))
            left.append(rest + sum(seconds[at + 1 :]))
            clock.now += length / 10
        frames.end()
    return found, np.array(left)


@pytest.mark.parametrize("own", [True, False])
def test_even_frames_say_the_time_of_all(own: bool) -> None:
    found, left = seen([12.0] * 8, own)
    whole = np.array([report.whole for report in found])
    assert (np.diff(whole) >= 0).all() and whole[0] == 0.0 and 0.95 < whole[-1] < 1.0
    assert all(report.left_s is None for report in found[:10]) is not own
    known = slice(0 if own else 10, None)
    said = [report.left_s for report in found[known]]
    np.testing.assert_allclose(said, left[known], rtol=0.02, atol=0.4)
    np.testing.assert_allclose(whole[known], 1.0 - left[known] / 96.0, atol=0.01)


def test_a_slow_first_frame_is_forgotten_and_the_bar_never_falls() -> None:
    found, left = seen([60.0] + [6.0] * 9, own=False)
    whole = np.array([report.whole for report in found])
    assert (np.diff(whole) >= 0).all()
    assert found[-25].left_s == pytest.approx(left[-25], rel=0.1)


def test_what_the_first_frame_compiled_is_none_of_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = iter([0.0, 0.0, 50.0, 50.0])
    monkeypatch.setattr("patchnet.patchnet_addon.runtime.frames_time.compiling_seconds", lambda: next(compiled))
    clock = Clock()
    frames = FramesTime(3, clock)
    frames.begin()
    clock.now += 56.0
    frames.end()
    frames.begin()
    assert frames.see(Progress(0, 1, "second")).left_s == pytest.approx(12.0)


def test_seconds_of_compilation_count_once() -> None:
    before = compiling.compiling_seconds()
    for change in (compiling.compilation_begins, compiling.compilation_begins):  # one calls another
        change()
    time.sleep(0.05)
    for change in (compiling.compilation_ends, compiling.compilation_ends):
        change()
    spent = compiling.compiling_seconds() - before
    assert spent > 0.04 and compiling.compiling_seconds() - before == spent and not compiling.is_compiling()


def test_frames_that_are_made_again_are_more_than_expected() -> None:
    clock = Clock()
    frames = FramesTime(1, clock)
    assert frames.skip(Progress(1, 1, "there")).whole == 0.0 and frames.text == "Frame 1 of 1"
    frames.one_more()
    frames.begin()
    clock.now += 5.0
    frames.end()
    assert frames.skip(Progress(1, 1, "there")).whole == pytest.approx(0.5) and frames.text == "Frame 2 of 2"
    frames.begin()
    clock.now += 50.0  # ten times as long as the one before
    report = frames.see(Progress(0, 1, "slow"))
    assert report.whole is not None and 0.5 < report.whole < 1.0 and report.left_s is not None and report.left_s > 0
