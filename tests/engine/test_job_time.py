# SPDX-License-Identifier: GPL-3.0-or-later
"""Share of a whole job and seconds left, with a clock that the test sets."""

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime.job_time import JobTime, duration_text, with_time
from patchnet.patchnet_addon.runtime.progress import Progress, Steps, drain
from patchnet.patchnet_addon.runtime.remaining import left_text


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def seen(lengths: dict[str, float], expected: dict[str, float], again: int = 1) -> list[Progress]:
    """Reports of a job whose stages take `lengths`, each in two steps of ten reports, and the last `again` times."""
    clock = Clock()
    job, found = JobTime(frozenset(list(lengths)[-1:]), clock), []
    job.expect(expected)
    for stage, seconds in lengths.items():
        rounds = again if stage == list(lengths)[-1] else 1
        for at in range(rounds * 2 * 10):
            found.append(job.see(stage, Progress(at % 10, 10, f"{stage} {at // 10}")))
            clock.now += seconds / (rounds * 20)
    return found


def test_a_job_as_expected_counts_each_second_once() -> None:
    lengths = {"depth": 5.0, "light": 60.0, "codes": 10.0, "views": 25.0}
    found = seen(lengths, lengths, again=3)
    whole = np.array([report.whole for report in found])
    each = np.concatenate(
        [np.full(count, seconds / count) for seconds, count in ((5.0, 20), (60.0, 20), (10.0, 20), (25.0, 60))]
    )
    times = np.cumsum(each) - each
    assert (np.diff(whole) >= 0).all(), "it never falls, whatever steps a stage has"
    np.testing.assert_allclose(whole, times / 100.0, atol=0.2)  # steps of a stage promise too much at their ends
    said = [
        (report.left_s, 100.0 - time) for report, time in zip(found, times, strict=True) if report.left_s is not None
    ]
    assert said and all(left < 2.0 * rest + 1.0 for left, rest in said)
    assert said[0][0] == pytest.approx(said[0][1], rel=0.5)
    assert said[-1][0] < 5.0 and whole[-1] < 1.0


@pytest.mark.parametrize("factor", [0.07, 0.3, 0.7, 1.0, 1.5, 3.0, 14.0])
def test_a_stage_of_another_pace_is_noticed_while_it_lasts(factor: float) -> None:
    expected = {"light": 60.0, "views": 20.0}
    clock = Clock()
    job = JobTime(clock=clock)
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
    """A bake of 40 s that was expected to take 64, then its denoising and its textures, then codes and views."""
    clock = Clock()
    job = JobTime(frozenset({"views"}), clock)
    job.expect({"light": 64.0, "denoise": 20.0, "codes": 10.0, "views": 30.0})
    left = []
    steps = [("light", "Baking", 40), ("light", "Packing", 2), ("denoise", "Denoising", 16), ("denoise", "Textures", 4)]
    steps += [("codes", "Encoding", 10), *(("views", f"View {number // 2} {number}", 5) for number in range(6))]
    for stage, label, seconds in steps:
        for at in range(seconds):
            fraction = at / seconds if stage in ("light", "views") else 0.0
            left.append(job.see(stage, Progress(fraction, 1, label)).left_s)
            clock.now += 1.0
    said = [value for value in left if value is not None]
    assert len(said) > 75 and max(np.diff(said)) < 3.0
    true = np.arange(len(left), 0, -1)[-len(said) :]
    assert abs(np.array(said) - true)[-60:].max() < 10.0


def test_a_short_step_at_the_start_of_a_stage_promises_nothing() -> None:
    clock = Clock()
    job = JobTime(clock=clock)
    job.expect({"light": 100.0})
    for at in range(11):
        found = job.see("light", Progress(at, 10, "Laying out charts"))
        clock.now += 0.05
    assert found.left_s is None and found.whole < 0.03


def test_nothing_is_said_before_something_is_known_nor_of_stages_that_are_over() -> None:
    clock = Clock()
    job = JobTime(clock=clock)
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


def test_steps_keep_their_result_and_are_closed() -> None:
    closed = []

    def steps() -> Steps[int]:
        try:
            yield Progress(0, 1, "Reading")
            yield Progress(1, 1, "Reading")
            return 7
        finally:
            closed.append(True)

    job = JobTime()
    job.expect({"read": 1.0})
    reports: list[Progress] = []
    assert drain(with_time(steps(), job, lambda: "read"), reports.append) == 7
    assert closed == [True] and [report.label for report in reports] == ["Reading"] * 2
    assert all(0.0 <= report.whole <= 1.0 for report in reports)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "1 s"), (40.0, "40 s"), (99.0, "99 s"), (150.0, "2 min"), (720.0, "12 min"), (9000.0, "2.5 h")],
)
def test_words(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text
    assert left_text(seconds) == ("" if seconds < 1.0 else f"about {text} left") and left_text(None) == ""
