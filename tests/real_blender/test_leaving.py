# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of leaving_window.py, and quit.blend."""

import json
import time
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

PATIENCE_S = 60.0  # for what takes a second or two; the bake that is left would take hours
LEAVES = ("disabled", "disabled in a render", "undone", "deleted scene", "other file")


@pytest.fixture(scope="module")
def seen(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of leaving_window.py."""
    folder = out / "leaving-temp"
    folder.mkdir()
    blender = Blender(installed.prefix, installed.program, installed.environment | {"TMPDIR": str(folder)})
    found = blender.visit("leaving", out, file=courtyard)
    assert found["code"] == 0 and "Saved session recovery" in found["said"], found["said"]
    return found | {"seconds to quit": time.time() - found["quits at"]}


def test_leaving_takes_a_moment_and_leaves_nothing(seen: dict) -> None:
    assert {name: seen[name]["changed"] for name in LEAVES} == {name: {} for name in LEAVES}
    assert max(seen[name]["seconds"] for name in ("disabled", "disabled in a render", "other file")) < PATIENCE_S
    assert seen["disabled in a render"]["rendered"]
    assert seen["seconds to quit"] < PATIENCE_S
    assert seen["deleted scene"]["told"] == ["The scene of this job was deleted or closed: open it and start again"]


def test_quit_blend_is_the_users_own(seen: dict, installed: Blender, out: Path) -> None:
    values = "s.render.engine, s.cycles.samples, s.cycles.use_sample_subset, s.cycles.sample_clamp_indirect"
    receivers = "s.objects['Sun'].light_linking.receiver_collection.name"
    ours = "[item.name for kind in (bpy.data.objects, bpy.data.scenes, bpy.data.materials) for item in kind]"
    line = f"import bpy, json; s = bpy.data.scenes['Scene']; print('is:', json.dumps([{values}, {receivers}, {ours}]))"
    done = installed.run("-b", "--factory-startup", out / "leaving-temp" / "quit.blend", "--python-expr", line)
    said = next(line for line in done.stdout.splitlines() if line.startswith("is: "))
    *settings, names = json.loads(said.removeprefix("is: "))
    assert settings == ["CYCLES", 64, False, 10.0, "Receivers"]
    assert [name for name in names if "PatchNet" in name] == []


def test_renders_come_first_and_the_job_goes_on(seen: dict) -> None:
    """PatchNet's own engine renders the light of the last round, or says that there is none yet."""
    assert seen["rendered by CYCLES"]["then"] == ["Preview Selection", "complete"]
    assert seen["rendered by PATCHNET"]["then"] in (["Preview Selection", "complete"], ["Preview Selection", "cancel"])
    assert seen["rendered by CYCLES"]["notes"] == ["waits for Blender's render"]  # the other one may end at once


def test_a_scene_that_is_made_meanwhile(seen: dict) -> None:
    """Blender crashed where a job's last step showed its scene in the place of another one than it began in."""
    assert seen["shown in the end"] == "PatchNet Courtyard"
