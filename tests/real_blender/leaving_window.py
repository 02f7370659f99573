# SPDX-License-Identifier: GPL-3.0-or-later
"""Interruptions of a bake: a render, disabling PatchNet, deleting the scene, undo, opening another file, quitting.

    blender --enable-event-simulate -p 0 0 1000 800 courtyard.blend -P leaving_window.py -- OUT

Writes observations to OUT/leaving.json, which test_leaving.py checks together with quit.blend.
"""

import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, PACKAGE, Heard, Visit, baking, choose, ends_of_renders, modal, module, press, render, running

SMALL = {
    "scope": "VISIBLE", "resolution": "DEPTH", "depth": 6, "size": (48, 32), "cameras": "Far", "budget": 0.1,
    "cells": "everywhere",
}  # fmt: skip
ENDLESS = 65536  # samples of a bake that no visit waits for
KINDS = ("objects", "meshes", "materials", "worlds", "lights", "cameras", "collections", "scenes", "images")

visit = Visit("leaving")
seen = visit.seen
heard = Heard()


def state() -> dict[str, object]:
    """State that a bake could leave changed: data-blocks, settings of the scene, modal operators, jobs."""
    scene = clicks.window().scene
    properties = [item for item in scene.cycles.bl_rna.properties if item.identifier != "rna_type"]
    linking = {lamp.name: lamp.light_linking.receiver_collection for lamp in scene.objects if lamp.type == "LIGHT"}
    names = {kind: sorted(item.name for item in getattr(bpy.data, kind)) for kind in KINDS}
    names["images"] = [name for name in names["images"] if not name.startswith("PatchNet") and name != "Render Result"]
    return names | {
        "render": [scene.render.engine, scene.render.bake.view_from, scene.world.name],
        "cycles": {item.identifier: str(getattr(scene.cycles, item.identifier)) for item in properties},
        "curves": [scene.cycles_curves.shape],
        "lamps": {name: item and item.name for name, item in linking.items()},
        "modal": [name for name in modal() if "render" not in name.lower()],
        "jobs": [kind for kind in ("OBJECT_BAKE", "RENDER") if bpy.app.is_job_running(kind)],
    }


def differences(before: dict[str, object]) -> dict[str, object]:
    """Changed entries; of lists, items that only one side has."""
    now, found = state(), {}
    for name in before:
        sides = [{str(item) for item in values.items()} if isinstance(values, dict) else {*map(str, values)}
                 for values in (before[name], now[name])]  # fmt: skip
        if sides[0] != sides[1]:
            found[name] = [sorted(sides[0] - sides[1]), sorted(sides[1] - sides[0])]
    return found


def start(samples: int) -> clicks.Session:
    """Start Preview Selection as its button does, and wait until Cycles bakes."""
    yield from baking(samples)
    yield 1.0


def left(name: str, leave) -> clicks.Session:
    """Start an endless bake, call `leave`, and record its seconds and the changed state."""
    choose(max_samples=ENDLESS, noise_threshold=0.0001)
    before = state()
    yield from start(ENDLESS)
    begun = time.monotonic()
    leave()
    took = round(time.monotonic() - begun, 1)
    yield 0.3
    yield from clicks.move(*clicks.over_viewport())  # the next event ends remaining operators
    yield 0.3
    seen[name] = {"seconds": took, "changed": differences(before)}


def prepare() -> clicks.Session:
    """Set small settings, a lamp linked to one object, and a user setting of Cycles."""
    scene = clicks.window().scene
    choose(**SMALL)
    scene.cycles.samples, scene.cycles.sample_clamp_indirect = 64, 10.0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 48, 32, 100
    receivers = bpy.data.collections.new("Receivers")
    receivers.objects.link(scene.objects["Back wall"])
    scene.objects["Sun"].light_linking.receiver_collection = receivers
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / "leaving.blend"))
    yield 0.3


def rendered(engine: str) -> clicks.Session:
    """A render during a bake: the job waits and continues."""
    scene, ended = clicks.window().scene, ends_of_renders()
    yield from start(ENDLESS)
    scene.cycles.samples = 512
    render(48, 32, engine)
    display = module("jobs.job_operator").job_in_window().display
    notes = set()
    while not ended:
        notes.add(display.progress.note)
        yield 0.05
    yield from clicks.wait_for(lambda: bpy.app.is_job_running("OBJECT_BAKE"), "the bake goes on", 120.0)
    yield 1.0
    seen[f"rendered by {engine}"] = {"then": [running(), *ended], "notes": sorted(notes - {""})}
    yield from clicks.key("ESC", *clicks.over_viewport())
    yield from clicks.wait_for(lambda: not running(), "Esc stops the job")
    scene.render.engine, scene.cycles.samples = "CYCLES", 64
    yield 0.5


def disabled() -> clicks.Session:
    """The extension is disabled and enabled again."""
    yield from left("disabled", lambda: bpy.ops.preferences.addon_disable(module=PACKAGE))
    bpy.ops.preferences.addon_enable(module=PACKAGE)
    yield 0.3


def disabled_in_a_render() -> clicks.Session:
    """The extension is disabled and enabled again during the user's Cycles render."""
    scene = clicks.window().scene
    scene.cycles.samples = ENDLESS
    before = state()
    render(48, 32, "CYCLES")
    yield 2.0
    begun, ran = time.monotonic(), bpy.app.is_job_running("RENDER")
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    took = round(time.monotonic() - begun, 1)
    yield 0.5
    seen["disabled in a render"] = {"seconds": took, "changed": differences(before), "rendered": ran}
    bpy.ops.preferences.addon_enable(module=PACKAGE)
    scene.cycles.samples = 64
    yield 0.3


def deleted_scene() -> clicks.Session:
    """The baked scene is deleted."""
    first = clicks.window().scene
    first_state = state()
    with bpy.context.temp_override(window=clicks.window()):
        bpy.ops.scene.new(type="LINK_COPY")
    yield 0.3
    yield from start(ENDLESS)
    with bpy.context.temp_override(window=clicks.window()):
        bpy.ops.scene.delete()
    yield from clicks.wait_for(lambda: not running(), "the job ends")
    yield 0.5
    yield from clicks.move(*clicks.over_viewport())
    yield 0.3
    clicks.window().scene = first
    seen["deleted scene"] = {"changed": differences(first_state), "told": heard.told[-1:]}


def other_scene_shown() -> clicks.Session:
    """A new scene is opened while a job adds the demo scene."""
    first = clicks.window().scene
    press("add_demo_scene")
    with bpy.context.temp_override(window=clicks.window()):
        bpy.ops.scene.new()
    yield from clicks.wait_for(lambda: not running(), "the demo scene is there")
    seen["shown in the end"] = clicks.window().scene.name
    clicks.window().scene = first
    for made in [each for each in bpy.data.scenes if each != first]:
        bpy.data.scenes.remove(made)
    yield 0.3


def undone() -> clicks.Session:
    """An undo step is pushed during a bake and restored later."""
    choose(max_samples=ENDLESS, noise_threshold=0.0001)
    bpy.ops.ed.undo_push(message="before")
    before = state()
    yield from start(ENDLESS)
    bpy.ops.ed.undo_push(message="while baking")
    yield from clicks.key("ESC", *clicks.over_viewport())
    yield from clicks.wait_for(lambda: not running(), "Esc stops the job")
    bpy.ops.ed.undo_push(message="later")
    bpy.ops.ed.undo()
    yield 0.5
    seen["undone"] = {"changed": differences(before)}


def other_file() -> clicks.Session:
    """Another file is opened."""
    yield from left("other file", lambda: bpy.ops.wm.open_mainfile(filepath=str(OUT / "leaving.blend")))


def quits() -> clicks.Session:
    """Blender quits after an undo step, which it writes into quit.blend."""
    yield from start(ENDLESS)
    bpy.ops.ed.undo_push(message="while baking")
    seen["quits at"] = time.time()
    visit.save("all")
    bpy.ops.wm.quit_blender()


def session() -> clicks.Session:
    """Run all parts."""
    yield from prepare()
    for part in (disabled, undone, deleted_scene, other_file):
        heard.__init__()
        yield from part()
        visit.save(part.__name__)
    heard.__init__()
    for engine in ("CYCLES", "PATCHNET"):
        yield from rendered(engine)
        visit.save(engine)
    yield from disabled_in_a_render()
    yield from other_scene_shown()
    visit.save("other scene")
    yield from quits()


visit.play(session(), pictures="NEVER")
