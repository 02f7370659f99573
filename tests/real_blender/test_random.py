# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks at random, without a crash and without a traceback. STEPS and SEED are variables, for longer tries by hand."""

import os
from pathlib import Path

from patchnet.tests.real_blender.executable import Blender

STEPS, SEED = os.environ.get("STEPS", "100"), os.environ.get("SEED", "0")


def test_clicks_at_random(installed: Blender, yard: Path, out: Path) -> None:
    """What was clicked before a crash is in random-steps.txt."""
    seen = installed.visit("random", out, STEPS, SEED, file=yard)
    assert seen["steps"] == int(STEPS) and seen["code"] == 0
