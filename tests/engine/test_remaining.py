# SPDX-License-Identifier: GPL-3.0-or-later
"""Remaining time, as it is told."""

import pytest

from patchnet.patchnet_addon.runtime.progress import Progress
from patchnet.patchnet_addon.runtime.remaining import Remaining


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_steady_steps(clock: Clock) -> None:
    remaining = Remaining(clock)
    for done in range(5):
        clock.now = 10.0 * done
        remaining.see(Progress(done, 10, "Baking"))
    assert remaining.seconds() == pytest.approx(60.0) and remaining.text() == "about 60 s left"
    clock.now += 4.0
    remaining.see(Progress(4, 10, "Baking", waiting=True))
    assert remaining.seconds() == pytest.approx(56.0), "time passes while nothing is reported"
    clock.now += 1000.0
    assert remaining.seconds() == 0.0 and remaining.text() == ""


def test_resumed_steps_are_measured_from_where_they_begin(clock: Clock) -> None:
    remaining = Remaining(clock)
    remaining.see(Progress(80, 100, "Baking"))
    assert remaining.seconds() is None
    clock.now = 5.0
    remaining.see(Progress(85, 100, "Baking"))
    assert remaining.seconds() == pytest.approx(15.0)


def test_each_label_is_a_step_of_its_own(clock: Clock) -> None:
    remaining = Remaining(clock)
    remaining.see(Progress(0, 2, "One"))
    clock.now = 50.0
    remaining.see(Progress(1, 2, "One"))
    remaining.see(Progress(0, 2, "Two"))
    assert remaining.text() == ""
    clock.now = 53.0
    remaining.see(Progress(1, 2, "Two"))
    assert remaining.seconds() == pytest.approx(3.0)
    remaining.see(Progress(0, 2, "Two"))
    assert remaining.seconds() is None, "the same step once more"


def test_a_whole_job_says_its_own_or_nothing(clock: Clock) -> None:
    remaining = Remaining(clock)
    remaining.see(Progress(0, 100, "Baking", whole=0.1))
    clock.now = 10.0
    remaining.see(Progress(50, 100, "Baking", whole=0.2))
    assert remaining.text() == "", "the step's own time is not the job's"
    remaining.see(Progress(50, 100, "Baking", whole=0.2, left_s=33.0))
    assert remaining.text() == "about 33 s left"


def test_words(clock: Clock) -> None:
    remaining = Remaining(clock)
    remaining.see(Progress(0, 100, "Long"))
    clock.now = 10.0
    remaining.see(Progress(5, 100, "Long"))
    assert remaining.text() == "about 3 min left"
    clock.now = 2500.0
    remaining.see(Progress(10, 100, "Long"))
    assert remaining.text() == "about 6.2 h left"
