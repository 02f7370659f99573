# SPDX-License-Identifier: GPL-3.0-or-later
"""A job, a rendered viewport and F12 in one session: threads, modules, imports and signals of Blender's process.

    blender --enable-event-simulate -p 0 0 1000 800 yard.blend -P session_window.py -- OUT

Writes OUT/session.json, which test_session.py judges.
"""

import signal
import sys
import threading
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import PACKAGE, Heard, Visit, choose, ends_of_renders, engine, press, render, running, watched

PATH_AT_START = sys.path[1:]
SMALL = {"scope": "VISIBLE", "resolution": "DEPTH", "depth": 6, "size": (48, 32), "cameras": "Far", "budget": 0.1}
EVERY_S = 0.02  # between two looks at the threads

visit = Visit("session")
seen = visit.seen
heard = Heard()
threads: set[str] = set()


def look() -> float:
    """Keep kinds and names of Python's threads; those of Blender's renders are no objects of Python, so dummies."""
    threads.update(f"{type(each).__name__} {each.name.partition('-')[0]}" for each in threading.enumerate())
    return EVERY_S


def handlers() -> list[str]:
    """Handlers of all signals."""
    return [f"{number.name}: {signal.getsignal(number)}" for number in sorted(signal.valid_signals())
            if isinstance(number, signal.Signals)]  # fmt: skip


def used() -> clicks.Session:
    """Preview Selection with baked light, shading mode Rendered, and a render."""
    press("run_all")
    yield from clicks.wait_for(lambda: running(), "the job begins")
    yield from clicks.wait_for(lambda: not running(), "the job ends", 300.0)
    seen["told"] = heard.told
    clicks.window().scene.render.engine = "PATCHNET"
    viewports: list = []
    watched(viewports)
    clicks.area("VIEW_3D").spaces.active.shading.type = "RENDERED"
    yield from clicks.wait_for(
        lambda: viewports and viewports[-1]._preview is not None and viewports[-1]._preview.done, "a preview", 180.0
    )
    clicks.area("VIEW_3D").spaces.active.shading.type = "SOLID"
    yield 0.5
    ended = ends_of_renders()
    render(48, 32)
    yield from clicks.wait_for(lambda: bool(ended), "the render ends", 180.0)
    seen["rendered"] = ended


def session() -> clicks.Session:
    """Use everything, and look at the process."""
    choose(**SMALL, max_samples=64, noise_threshold=0.1)
    bpy.app.timers.register(look, persistent=True)
    before, path = handlers(), list(sys.path)
    yield from used()
    bpy.app.timers.unregister(look)
    own = [name for name in sys.modules if name.startswith(f"{PACKAGE}.")]
    packages = {name.partition(".")[0] for name in sys.modules}
    seen["signals"] = {"at start": before, "changed": sorted(set(handlers()) ^ set(before))}
    seen["path"] = {"at start": PATH_AT_START, "changed": [name for name in sys.path if name not in path]}
    seen["compilers"] = sorted({"numba", "llvmlite", "torch"} & packages)
    seen["kernels"] = sorted(
        name for name in own if name.endswith((".runtime.kernels", ".runtime.threads"))
        or "numba" in vars(sys.modules[name])
    )  # fmt: skip
    seen["own modules"] = len(own)
    seen["threads"] = sorted(threads)
    seen["engine"] = engine("process.computed").engine_pid() is not None


visit.play(session(), pictures="NEVER")
