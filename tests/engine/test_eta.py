# SPDX-License-Identifier: GPL-3.0-or-later
"""Remaining time and finished share of steps, jobs and animations, with a simulated clock."""

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime import stage_clock
from patchnet.patchnet_addon.runtime.eta import Eta, FramesEta, JobEta, duration_text, left_text
from patchnet.patchnet_addon.runtime.progress import Progress


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_stages_within_another_one_do_not_count_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the views that are shown between two rounds of a bake."""
    clock = Clock()
    monkeypatch.setattr(stage_clock.time, "perf_counter", clock)
    stages = stage_clock.StageClock()

    def spend(name: str, seconds: float) -> None:
        with stages.stage(name):
            clock.now += seconds

    with stages.stage("light"):
        clock.now += 5.0
        spend("codes", 2.0)
        spend("views", 3.0)
        assert stages.present == "light"
        clock.now += 1.0
    spend("views", 4.0)
    assert stages.present == "views" and stages.seconds == {"codes": 2.0, "views": 7.0, "light": 6.0}


def test_a_job_is_not_nearly_done_while_views_of_a_first_round_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bake of two rounds of 20 s with 5 s of views between them, and of 20 s after them."""
    clock = Clock()
    monkeypatch.setattr(stage_clock.time, "perf_counter", clock)
    stages, job = stage_clock.StageClock(), JobEta(frozenset({"views"}), clock)
    job.expect({"light": 40.0, "views": 20.0})
    whole: list[float | None] = []

    def work(label: str, seconds: int) -> None:
        for at in range(seconds):
            whole.append(job.see(stages.present, Progress(at, seconds, label)).whole)
            clock.now += 1.0

    with stages.stage("light"):
        work("Baking", 20)
        with stages.stage("views"):
            work("View", 5)
        work("Refining", 20)
    with stages.stage("views"):
        work("View", 20)
    true = np.arange(65) / 65
    assert np.abs(np.array(whole, float) - true).max() < 0.2


@pytest.mark.parametrize("factor", [0.07, 0.3, 0.7, 1.0, 1.5, 3.0, 14.0])
def test_a_stage_of_another_pace_is_noticed_while_it_lasts(factor: float) -> None:
    expected = {"light": 60.0, "views": 20.0}
    clock = Clock()
    job = JobEta(clock=clock)
    job.expect(expected)
    found = []
    for at in range(100):
        found.append(job.see("light", Progress(at, 100, "Baking light")))
        clock.now += 0.6 * factor
    true = [20.0 + (1 - at / 100) * 60.0 * factor for at in range(100)]
    said = [at for at in range(100) if found[at].left_s is not None]
    assert said == [] or 0.5 * true[said[0]] < found[said[0]].left_s < 2.0 * true[said[0]]
    for at in {60, 90} & set(said):
        planned = 20.0 + max(60.0 - at * 0.6 * factor, 0.0)
        assert abs(found[at].left_s - true[at]) <= 0.75 * abs(planned - true[at]) + 1e-6
    whole = [report.whole for report in found]
    assert whole == sorted(whole)


def test_time_left_does_not_rise_when_a_stage_that_was_fast_goes_on() -> None:
    """A bake of 40 s that was expected to take 64, then its filter and the voxels, then codes and views."""
    clock = Clock()
    job = JobEta(frozenset({"views"}), clock)
    job.expect({"light": 64.0, "voxelize": 20.0, "codes": 10.0, "views": 30.0})
    left = []
    steps = [("light", "Baking", 40), ("light", "Filtering", 2), ("voxelize", "Voxelizing", 16)]
    steps += [
        ("voxelize", "Levels", 4),
        ("codes", "Encoding", 10),
        *(("views", f"View {number // 2} {number}", 5) for number in range(6)),
    ]
    for stage, label, seconds in steps:
        for at in range(seconds):
            fraction = at / seconds if stage in ("light", "views") else 0.0
            left.append(job.see(stage, Progress(fraction, 1, label)).left_s)
            clock.now += 1.0
    said = [value for value in left if value is not None]
    assert len(said) > 75 and max(np.diff(said)) < 3.0
    true = np.arange(len(left), 0, -1)[-len(said) :]
    assert abs(np.array(said) - true)[-60:].max() < 10.0


def test_nothing_is_said_before_something_is_known_nor_of_stages_that_are_over() -> None:
    clock = Clock()
    job = JobEta(clock=clock)
    first = job.see("read", Progress(0, 1, "Reading"))
    assert first.whole is None and first.left_s is None
    job.expect({"read": 1000.0, "depth": 10.0, "light": 30.0})
    clock.now += 1.0
    job.see("light", Progress(0, 10, "Baking"))
    clock.now += 3.0
    assert job.see("light", Progress(1, 10, "Baking")).left_s == pytest.approx(27.0, abs=1.5), "it read faster"
    assert job.see("else", Progress(0, 1, "Writing")).left_s is not None
    assert not job.compiled
    job.see("light", Progress(0, 1, "Baking", note="compiling, once on this machine"))
    assert job.compiled == {"light"}


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "1 s"), (40.0, "40 s"), (99.0, "99 s"), (150.0, "2 min"), (720.0, "12 min"), (9000.0, "2.5 h")],
)
def test_words(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text
    assert left_text(seconds) == ("" if seconds < 1.0 else f"about {text} left") and left_text(None) == ""


def test_steady_steps() -> None:
    clock = Clock()
    eta = Eta(clock)
    for done in range(5):
        clock.now = 10.0 * done
        eta.see(Progress(done, 10, "Baking"))
    assert eta.seconds() == pytest.approx(60.0) and eta.text() == "about 60 s left"
    clock.now += 4.0
    eta.see(Progress(4, 10, "Baking", waiting=True))
    assert eta.seconds() == pytest.approx(56.0), "time passes while nothing is reported"
    clock.now += 1000.0
    assert eta.seconds() == 0.0 and eta.text() == ""


def test_a_whole_job_says_its_own_or_nothing() -> None:
    clock = Clock()
    eta = Eta(clock)
    eta.see(Progress(0, 100, "Baking", whole=0.1))
    clock.now = 10.0
    eta.see(Progress(50, 100, "Baking", whole=0.2))
    assert eta.text() == "", "the step's own time is not the job's"
    eta.see(Progress(50, 100, "Baking", whole=0.2, left_s=33.0))
    assert eta.text() == "about 33 s left"


def seen_frames(seconds: list[float], own: bool, expected: int | None = None) -> tuple[list[Progress], np.ndarray]:
    """Reports of frames that take `seconds`, ten each, and the seconds really left; own: frames say theirs."""
    clock = Clock()
    frames, found, left = FramesEta(len(seconds) if expected is None else expected, clock), [], []
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
    found, left = seen_frames([12.0] * 8, own)
    whole = np.array([report.whole for report in found])
    assert (np.diff(whole) >= 0).all() and whole[0] == 0.0 and 0.95 < whole[-1] < 1.0
    assert all(report.left_s is None for report in found[:10]) is not own
    known = slice(0 if own else 10, None)
    said = [report.left_s for report in found[known]]
    np.testing.assert_allclose(said, left[known], rtol=0.02, atol=0.4)
    np.testing.assert_allclose(whole[known], 1.0 - left[known] / 96.0, atol=0.01)
