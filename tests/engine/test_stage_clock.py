# SPDX-License-Identifier: GPL-3.0-or-later
"""Stages of a job: their peaks of memory, and one that fails."""

import subprocess
import sys

import pytest

from patchnet.patchnet_addon.runtime.stage_clock import StageClock

MEGABYTE = 1 << 20

PEAKS = f"""
import numpy as np
from {StageClock.__module__} import StageClock
clock = StageClock(memory=True)
with clock.stage("large"):
    np.ones({100 * MEGABYTE}, np.uint8).sum()
with clock.stage("small"):
    pass
large, small = clock.stages["large"], clock.stages["small"]
assert large.peak_bytes >= large.before_bytes + {99 * MEGABYTE}, large
assert small.peak_bytes < large.peak_bytes - {50 * MEGABYTE}, small
assert clock.as_json()["peak_bytes"] >= large.peak_bytes
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells the memory of a process in /proc")
def test_stages_know_their_own_peak():
    """In a process of its own: the system takes memory back from one that holds much of it at any time."""
    subprocess.run([sys.executable, "-c", PEAKS], check=True)


def test_a_stage_that_fails_leaves_nothing():
    clock = StageClock()
    with pytest.raises(ValueError, match="broken"), clock.stage("broken"):
        raise ValueError("broken")
    assert clock.as_json()["stages"] == {}
