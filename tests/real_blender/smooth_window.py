# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview a scene in a window, look at it and render it, and note times, memory and gaps between timer events.

    blender -p 0 0 1000 800 courtyard.blend -P smooth_window.py -- OUT NAME DEPTH

Writes OUT/NAME.json. bench_window.py tells what it found.
"""

import importlib
import statistics
import sys
import time
from pathlib import Path

import bpy
from mathutils import Quaternion

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import PACKAGE, Visit, choose, ends_of_renders, module, press, render, running

NAME, DEPTH = sys.argv[-2], int(sys.argv[-1])
SETTINGS = {
    "scope": "VISIBLE", "resolution": "DEPTH", "depth": DEPTH, "max_samples": 16, "cameras": "Middle",
    "size": (480, 270),
}  # fmt: skip
_TICK_S = 0.002
_MOST = 12  # gaps that are told

visit = Visit(NAME)
seen = visit.seen
memory = importlib.import_module(f"{PACKAGE}.patchnet_addon.runtime.memory")


class Watch(bpy.types.Operator):
    """Hears the events of a timer."""

    bl_idname = "wm.patchnet_watch"
    bl_label = "Watch"
    times: list[tuple[float, str]] = []
    peak = 0
    on = True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.timer = context.window_manager.event_timer_add(_TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "TIMER":
            job = module("jobs.job_operator").job_in_window()
            label = job.display.progress.label if job.display else ""
            Watch.times.append((time.monotonic(), label))
            Watch.peak = max(Watch.peak, memory.resident_bytes() or 0)
        return {"PASS_THROUGH"} if Watch.on else {"FINISHED"}


def first(word: str) -> float | None:
    """Seconds until a label holds a word."""
    begun = Watch.times[0][0]
    return next((round(at - begun, 3) for at, label in Watch.times if word in label), None)


def gaps() -> dict[str, object]:
    """What is told of the gaps so far."""
    found = [(1000.0 * (b[0] - a[0]), a[1], b[1]) for a, b in zip(Watch.times, Watch.times[1:], strict=False)]
    found_ms = [gap for gap, *_ in found]
    return {
        "seconds": round(Watch.times[-1][0] - Watch.times[0][0], 2),
        "median_ms": round(statistics.median(found_ms), 2),
        "longest_ms": round(max(found_ms)),
        "above_50_ms": sum(gap > 50.0 for gap in found_ms),
        "longest": [f"{gap:.0f} {' -> '.join(labels)}" for gap, *labels in sorted(found, reverse=True)[:_MOST]],
    }


def redraws() -> clicks.Session:
    """Gaps while nothing computes, but the window is drawn again and again, as for a job's progress and pictures."""
    Watch.times.clear()
    for _ in range(20):
        yield 0.1
        for area in clicks.window().screen.areas:
            area.tag_redraw()
    return gaps()


def job(viewport: bpy.types.Area | None = None) -> clicks.Session:
    """Gaps of a job, with another editor in place of a viewport, which takes long to draw without a graphics card."""
    press("run_all")
    if viewport is not None:
        viewport.type = "TEXT_EDITOR"
        yield 1.0
    Watch.times.clear()
    yield from clicks.wait_for(lambda: not running(), "the job ends", 1200.0)
    return gaps() | {"baking_s": first("Baking light"), "stand_in_s": first("Looking where")}


def own_render() -> clicks.Session:
    """Gaps of what a user would do instead: F12, with Cycles."""
    bpy.context.preferences.view.render_display_type = "NONE"
    clicks.window().scene.cycles.samples, ended = 64, ends_of_renders()
    Watch.times.clear()
    render(*SETTINGS["size"], engine="CYCLES")
    yield from clicks.wait_for(lambda: bool(ended), "Cycles has rendered", 300.0)
    return gaps()


def own_bake() -> clicks.Session:
    """Gaps of Blender's own bake into an image of a plane, beside the same viewport."""
    with bpy.context.temp_override(window=clicks.window(), area=clicks.area("VIEW_3D"), region=clicks.region("WINDOW")):
        bpy.ops.mesh.primitive_plane_add(size=8.0)
        plane = bpy.context.object
        plane.data.materials.append(bpy.data.materials.new("Own"))
        nodes = plane.active_material.node_tree.nodes
        nodes.active = nodes.new("ShaderNodeTexImage")
        nodes.active.image = bpy.data.images.new("Own", 256, 256)
        Watch.times.clear()
        bpy.ops.object.bake("INVOKE_DEFAULT", type="COMBINED")
    yield from clicks.wait_for(lambda: not bpy.app.is_job_running("OBJECT_BAKE"), "Cycles has baked", 300.0)
    bpy.data.objects.remove(plane)
    return gaps()


def viewport() -> clicks.Session:
    """Time that our engine takes of a frame of the viewport, in which it refines a view, and then of many views."""
    kind = importlib.import_module(f"{PACKAGE}.operators.render_engine.viewport").Viewport
    before, taken_ms = kind.draw, []

    def draw(self, *given):
        begun = time.perf_counter()
        before(self, *given)
        taken_ms.append(1000.0 * (time.perf_counter() - begun))

    kind.draw = draw
    space = clicks.area("VIEW_3D").spaces.active
    clicks.window().scene.render.engine, space.region_3d.view_perspective = "PATCHNET", "CAMERA"
    space.shading.type = "RENDERED"
    yield 5.0
    found = {"refining_ms": told(taken_ms)}
    taken_ms.clear()
    space.region_3d.view_perspective = "PERSP"
    for _ in range(60):
        space.region_3d.view_rotation = Quaternion((0, 0, 1), 0.02) @ space.region_3d.view_rotation
        yield 0.02
    found["orbiting_ms"] = told(taken_ms)
    space.shading.type, kind.draw = "SOLID", before
    return found


def told(taken_ms: list[float]) -> dict[str, float]:
    """Median and longest of some times."""
    return {"frames": len(taken_ms), "median": round(statistics.median(taken_ms), 1), "longest": round(max(taken_ms))}


def session() -> clicks.Session:
    """The whole visit."""
    bpy.utils.register_class(Watch)
    choose(**SETTINGS)
    yield 1.0
    before = memory.resident_bytes()
    with bpy.context.temp_override(window=clicks.window()):
        bpy.ops.wm.patchnet_watch("INVOKE_DEFAULT")
    seen["redraws"] = yield from redraws()
    seen["job"] = yield from job()
    seen["memory_mb"] = {"before": before >> 20, "peak": Watch.peak >> 20}
    yield 2.0
    seen["memory_mb"]["after"] = memory.resident_bytes() >> 20
    seen["viewport"] = yield from viewport()
    bpy.ops.patchnet.clear_results()
    yield 2.0
    seen["memory_mb"]["freed"] = memory.resident_bytes() >> 20
    seen["render"] = yield from own_render()
    seen["bake"] = yield from own_bake()
    clicks.window().scene.objects["Sun"].rotation_euler.z += 0.1
    yield 1.0
    seen["job without viewport"] = yield from job(clicks.area("VIEW_3D"))
    Watch.on = False
    yield 0.2


visit.play(session())
