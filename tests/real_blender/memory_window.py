# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview a scene, look around, render, free the memory. No kernel is compiled before.

    blender --enable-event-simulate -p 0 0 1000 800 courtyard.blend -P memory_window.py -- OUT

Writes OUT/memory.json: bytes of the process after each part, and what the panel says. test_memory.py judges them.
"""

import math
import sys
from pathlib import Path

import bpy
from mathutils import Quaternion

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import Heard, Visit, choose, ends_of_renders, engine, module, press, render, running

SETTINGS = {"scope": "VISIBLE", "resolution": "DEPTH", "depth": 9, "max_samples": 2, "cameras": "Middle"}

visit = Visit("memory")
seen = visit.seen
heard = Heard()


def process_bytes() -> int:
    """Resident bytes of this process's own memory, and all bytes of segments that it shares with the engine."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    own = sum(int(status[name].split()[0]) << 10 for name in ("RssAnon", "RssFile"))
    places = [line.split(maxsplit=1)[0] for line in Path("/proc/self/maps").read_text().splitlines()
              if "memfd:patchnet" in line]  # fmt: skip
    ends = [[int(end, 16) for end in place.split("-")] for place in places]
    return own + sum(last - first for first, last in ends)


def measure(part: str, looks: int = 1) -> clicks.Session:
    """The process's bytes, the least of some looks, and what the panel says of them."""
    found = []
    for _ in range(looks):
        yield 1.0
        found.append(process_bytes())
    held = module("session.scene_session").held()
    seen[part] = {"process": min(found), "results": held.results, "images": held.images}
    visit.save(part)


def close_windows() -> clicks.Session:
    """Every window but the first."""
    while len(bpy.context.window_manager.windows) > 1:
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
            bpy.ops.wm.window_close()
        yield 0.5


def rendered(by: str) -> clicks.Session:
    """F12, and the window with the picture closed again."""
    ended = ends_of_renders()
    clicks.window().scene.cycles.samples = 1
    render(480, 270, by)
    yield from clicks.wait_for(lambda: bool(ended), f"the render by {by} ends", 200.0)
    yield 1.0
    yield from close_windows()


def preview() -> clicks.Session:
    """The whole job."""
    choose(**SETTINGS)
    press("run_all")
    yield from clicks.wait_for(lambda: not running(), "the job ends", 1200.0)  # kernels take a minute or more
    seen["steps"] = list(heard.labels)
    seen["compilers"] = sorted({"numba", "llvmlite"} & set(sys.modules))
    seen["engine"] = engine("process.computed").engine_pid() is not None
    yield from measure("job")


def look_around() -> clicks.Session:
    """The viewport in the shading mode of the render engine, from ten sides."""
    clicks.window().scene.render.engine = "PATCHNET"
    space = clicks.area("VIEW_3D").spaces.active
    space.shading.type = "RENDERED"
    for _ in range(10):
        space.region_3d.view_rotation = Quaternion((0, 0, 1), math.radians(6)) @ space.region_3d.view_rotation
        yield 0.5
    yield 2.0
    yield from measure("viewport")


def free() -> clicks.Session:
    """Free Memory, with the viewport as it was in the beginning."""
    clicks.area("VIEW_3D").spaces.active.shading.type = "SOLID"
    yield 0.5
    bpy.ops.patchnet.clear_results()
    yield from measure("freed", looks=5)


def session() -> clicks.Session:
    """The whole visit. Blender keeps 100 MB and more of its first render with Cycles, whoever asks for it."""
    yield from measure("start")
    yield from rendered("CYCLES")
    yield from measure("rendered by Cycles")
    yield from preview()
    yield from look_around()
    yield from rendered("PATCHNET")
    yield from measure("rendered")
    yield from free()


visit.play(session(), pictures="WINDOW")
