# SPDX-License-Identifier: GPL-3.0-or-later
"""Kill the engine process in each stage of a job, stop jobs by Esc, close Blender.

    blender --enable-event-simulate -p 0 0 1000 800 yard.blend -P killed_window.py -- OUT

Writes OUT/killed.json. test_killed.py judges it.
"""

import os
import signal
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from killed_stages import STAGES
from visits import Heard, Visit, choose, engine, module, press, result, running

SETTINGS = {
    "scope": "VISIBLE", "resolution": "DEPTH", "depth": 8, "size": (320, 240), "cameras": "Far", "max_samples": 8
}  # fmt: skip

visit = Visit("killed")
seen = visit.seen
process = engine("process.computed")


class Killer:
    """Kills the engine at the first report whose label holds a word."""

    def __init__(self) -> None:
        self.word = ""
        display = module("jobs.job_window").JobDisplay
        see = display.see

        def killing_see(shown, progress):
            see(shown, progress)
            if self.word and self.word in progress.label and process.engine_pid():
                self.word = ""
                os.kill(process.engine_pid(), signal.SIGKILL)

        display.see = killing_see


def job() -> clicks.Session:
    """Preview the scene to the end of the job."""
    press("run_all")
    yield from clicks.wait_for(lambda: not running(), "the job ends", 300.0)
    yield 0.1


def kill_in_each_stage() -> clicks.Session:
    """The job ends with a sentence; the result that was there stays, and the next job works."""
    heard, killer = Heard(), Killer()
    yield from job()
    before = result()
    seen["first"] = {"told": heard.told[-1:], "voxels": before is not None}
    seen["killed"] = {}
    for stage in STAGES:
        clicks.window().scene.patchnet.depth = 7 if clicks.window().scene.patchnet.depth == 8 else 8
        clicks.window().scene.objects["Sun"].data.energy += 0.1  # else kept light is found
        kept, told = result(), len(heard.told)
        killer.word = stage
        yield from job()
        seen["killed"][stage] = {
            "killed": not killer.word,
            "told": heard.told[told:],
            "kept": result() is kept and bool(kept.octree.luminance.any()),
        }
        killer.word = ""
    told = len(heard.told)
    yield from job()
    seen["after"] = {"told": heard.told[told:], "voxels": result() is not None}


def escape() -> clicks.Session:
    """Esc while the engine computes, in a step that would take long, and while Cycles bakes."""
    clicks.window().scene.patchnet.depth = 10
    for word in ("Finding the depth", "Looking where cameras look", "Voxelizing"):
        heard = Heard()
        press("run_all")
        yield from clicks.wait_for(lambda: any(word in label for label in heard.labels), f"{word} begins", 120.0)  # noqa: B023
        begun = time.monotonic()
        clicks.window().event_simulate(type="ESC", value="PRESS", x=500, y=400)
        while running() and time.monotonic() - begun < 30.0:
            yield 0.0
        seen.setdefault("escape", {})[word] = round(time.monotonic() - begun, 3)
        yield 0.3


def session() -> clicks.Session:
    """The whole visit."""
    choose(**SETTINGS)
    yield from visit.parts(kill_in_each_stage, escape)
    seen["pid"] = process.engine_pid()
    visit.save("end")


visit.play(session())
