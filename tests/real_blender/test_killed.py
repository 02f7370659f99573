# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of killed_window.py: the engine process ends in each stage, by Esc, and with Blender."""

import time
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender
from patchnet.tests.real_blender.killed_stages import STAGES


@pytest.fixture(scope="module")
def seen(installed: Blender, yard: Path, out: Path) -> dict:
    """Report of killed_window.py."""
    return installed.visit("killed", out, file=yard)


GONE = "PatchNet's engine has ended (signal 9): run this again; what was finished is kept"


@pytest.mark.parametrize("stage", STAGES)
def test_a_killed_engine_is_a_sentence(seen: dict, stage: str) -> None:
    found = seen["killed"][stage]
    assert found["killed"], "the stage was there"
    if stage == "Ranking pixels" and found["told"][-1:] != [GONE]:  # it was killed between two calls
        assert found["told"][-1].startswith("1 view")
    else:
        assert found["told"] == [GONE] and found["kept"]


def test_the_next_job_works(seen: dict) -> None:
    assert seen["after"]["voxels"] and seen["after"]["told"][-1].startswith("1 view")


def test_escape_ends_a_job(seen: dict) -> None:
    print(seen["escape"])
    assert max(seen["escape"].values()) < 5.0, "0.2 s, beside other processes"


def test_no_engine_is_left(seen: dict) -> None:
    deadline = time.monotonic() + 5.0
    while Path(f"/proc/{seen['pid']}").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not Path(f"/proc/{seen['pid']}").exists()
