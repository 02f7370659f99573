# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks at random, without a crash and without a traceback. STEPS and SEED are variables, for longer tries by hand."""

import json
import os
from pathlib import Path

from patchnet.tests.real_blender.executable import SMALL_SCREEN, Blender

STEPS, SEED = os.environ.get("STEPS", "100"), os.environ.get("SEED", "0")


def test_clicks_at_random(installed: Blender, courtyard: Path, out: Path) -> None:
    script = Path(__file__).with_name("random_window.py")
    seconds = 300.0 + 5.0 * int(STEPS)
    done = installed.run_window(courtyard, "-P", script, "--", out, STEPS, SEED, seconds=seconds, screen=SMALL_SCREEN)
    said = done.stdout + done.stderr
    (out / "random.log").write_text(said)
    assert (out / "random.json").exists(), f"Blender crashed: see {out / 'random-steps.txt'} and random.log"
    seen = json.loads((out / "random.json").read_text())
    assert (seen["problem"], seen["steps"]) == ("", int(STEPS))
    assert "Traceback" not in said
    assert done.returncode == 0
