# SPDX-License-Identifier: GPL-3.0-or-later
"""Use the tab in a window: press every button, stop a job, undo, look at pictures.

    blender --enable-event-simulate -p 0 0 1500 1000 courtyard.blend -P tab_window.py -- OUT

Writes OUT/tab.json, a value for each thing that was seen, and screenshots beside it. test_window.py judges them.
"""

import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, Heard, Visit, choose, open_panels, open_tab, result, running, side_box

SMALL = {"resolution": "DEPTH", "depth": 6, "max_samples": 2, "size": (48, 32), "cameras": "Far"}

STEPS = ("run_all", "voxelize", "bake_light", "precompute_codes", "render_preview")

visit = Visit("tab")
seen = visit.seen
heard = Heard()


def pictures() -> list[str]:
    """Names of our images."""
    return sorted(image.name for image in bpy.data.images if image.name.startswith("PatchNet"))


def blocks() -> dict[str, list[str]]:
    """Names of all data-blocks that a bake could leave behind, and what is selected."""
    kinds = ("objects", "meshes", "materials", "images", "worlds", "lights", "node_groups", "collections", "scenes")
    named = {kind: sorted(item.name_full for item in getattr(bpy.data, kind)) for kind in kinds}
    layer = clicks.window().view_layer
    return named | {"selected": sorted(item.name for item in layer.objects if item.select_get())}


def job(buttons: dict[str, tuple[int, int]], name: str) -> clicks.Session:
    """Click a button and wait for its job."""
    place = yield from clicks.find_again(name, buttons[name])
    before = len(heard.begun)
    yield from clicks.click(place)
    yield from clicks.wait_for(lambda: len(heard.begun) > before, "the button starts its job", 60.0)
    yield from clicks.wait_for(lambda: not running(), f"the job of {name} ends", 200.0)
    yield 0.2


def tab() -> clicks.Session:
    """The sidebar opens; the tab is chosen, with all its panels."""
    choose(**SMALL)
    open_panels()
    yield from open_tab()
    seen["tab"] = clicks.region("UI").active_panel_category
    yield from clicks.screenshot(OUT / "window-start.png")


def too_early(buttons: dict[str, tuple[int, int]]):
    """Steps without what they need are grey: a click does nothing."""
    yield from clicks.click(buttons["patchnet.bake_light"])
    yield 0.5
    seen["bake before voxels"] = {"running": running(), "result": result() is not None}


def nothing_selected(buttons: dict[str, tuple[int, int]]):
    """An error is a message, not a traceback, and leaves things as they are."""
    for item in clicks.window().view_layer.objects:
        item.select_set(False)
    yield from clicks.click(buttons["patchnet.voxelize"])
    yield 0.7
    yield from clicks.wait_for(lambda: not running(), "the step has ended", 110.0)
    seen["voxelize nothing"] = {"running": running(), "result": result() is not None}
    yield from clicks.dismiss()


def step_by_step(buttons: dict[str, tuple[int, int]]):
    """Select all, then the buttons from top to bottom; the first bake is stopped."""
    settings = clicks.window().scene.patchnet
    yield from clicks.key("A", *clicks.over_viewport())
    yield 0.3
    before = blocks()
    yield from job(buttons, "patchnet.voxelize")
    seen["octree"] = {"voxels": result().octree.leaf_count, "depth": result().octree.depth}
    settings.max_samples, settings.noise_threshold = 65536, 0.0001  # many minutes, beside which the window lives
    seen["stopped bake"] = yield from stopped_job(buttons, "patchnet.bake_light")
    seen["stopped bake"] |= {"light": result().light, "unchanged": blocks() == before}
    settings.max_samples = 2
    yield from job(buttons, "patchnet.bake_light")
    seen["light"] = result().light
    yield from job(buttons, "patchnet.precompute_codes")
    seen["codes"] = len(result().coded.codes)
    yield from job(buttons, "patchnet.render_preview")
    seen["pictures"] = pictures()
    seen["stale after own work"] = sorted(result().stale)
    after = blocks()
    after["images"] = [name for name in after["images"] if not name.startswith("PatchNet")]
    seen["unchanged by steps"] = after == before
    yield from clicks.screenshot(OUT / "window-steps.png")
    yield from clicks.screenshot(OUT / "panel-result.png", side_box())


def stopped_job(buttons: dict[str, tuple[int, int]], name: str):
    """Start a bake that would take hours, look at its progress while Cycles is at work, press Esc."""
    yield from clicks.click((yield from clicks.find_again(name, buttons[name])))
    yield from clicks.wait_for(lambda: bpy.app.is_job_running("OBJECT_BAKE"), "Cycles bakes beside the window", 120.0)
    yield 1.5
    yield from clicks.screenshot(OUT / "window-progress.png")
    was_running = running()
    start = time.monotonic()
    yield from clicks.key("ESC", *clicks.over_viewport())
    yield from clicks.wait_for(lambda: not running(), "Esc stops the job")
    stopped = time.monotonic()
    yield 0.5
    return {"was_running": was_running, "seconds_to_stop": round(stopped - start, 1)}


def change_and_undo(_buttons: dict[str, tuple[int, int]]):
    """Moving an object makes the result stale, and says so; undo and redo with it, and all still lives."""
    name, (x, y) = "Back wall", clicks.over_viewport()
    was = tuple(bpy.data.objects[name].location)
    for item in clicks.window().view_layer.objects:
        item.select_set(item.name == name)
    clicks.window().view_layer.objects.active = bpy.data.objects[name]
    bpy.ops.ed.undo_push(message="before")
    states = seen["stale"] = [sorted(result().stale)]
    yield from clicks.move(x, y)
    yield from clicks.key("G", x, y)
    yield from clicks.move(x + 40, y + 40)
    yield from clicks.key("LEFTMOUSE", x + 40, y + 40)
    while clicks.window().modal_operators:  # a move that has not ended yet is no step that undo could take back
        yield 0.1
    yield from clicks.wait_for(lambda: result().stale, "the change is noticed after a pause")
    states.append(sorted(result().stale))
    seen["why"] = result().why("surface")
    yield from clicks.screenshot(OUT / "panel-stale.png", side_box())
    yield from clicks.key("Z", x, y, ctrl=True)
    yield from clicks.wait_for(lambda: not result().stale, "undo is noticed")
    states.append(sorted(result().stale))
    seen["undone"] = tuple(bpy.data.objects[name].location) == was
    bpy.ops.ed.redo()
    yield from clicks.wait_for(lambda: result().stale, "redo is noticed")
    states.append(sorted(result().stale))
    yield from clicks.key("A", x, y)
    yield 0.3


def all_at_once(buttons: dict[str, tuple[int, int]]):
    """Preview Selection does everything, with files."""
    window = clicks.window()
    window.scene.patchnet.out = str(OUT / "run-all")
    yield from job(buttons, "patchnet.run_all")
    seen["files"] = sorted(str(path.relative_to(OUT / "run-all")) for path in (OUT / "run-all").rglob("*.*"))
    shown = clicks.area("VIEW_3D")
    shown.type = "IMAGE_EDITOR"
    yield 0.3
    shown.spaces.active.image = bpy.data.images.get("PatchNet Far heatmap")
    with bpy.context.temp_override(window=window, area=shown, region=clicks.region("WINDOW", "IMAGE_EDITOR")):
        bpy.ops.image.view_all(fit_view=True)
    yield from clicks.screenshot(OUT / "window-heatmap.png")
    shown.type = "VIEW_3D"
    yield 0.5


def free_memory(_buttons: dict[str, tuple[int, int]]):
    """The last button, which was not there in the beginning, gives the memory back."""
    yield from clicks.scroll("UI")  # the tab is longer than the window by now
    buttons = yield from clicks.find_buttons({"patchnet.clear_results"}, upwards=True)
    yield from clicks.click(buttons["patchnet.clear_results"])
    yield 0.3
    seen["freed"] = result() is None


PARTS = (too_early, nothing_selected, step_by_step, change_and_undo, all_at_once, free_memory)


def session():
    """The whole visit."""
    yield from tab()
    buttons = yield from clicks.find_buttons({f"patchnet.{name}" for name in STEPS})
    seen["buttons"] = sorted(buttons)
    for part in PARTS:
        yield from part(buttons)
        visit.save(part.__name__)


visit.play(session(), pictures="EDITOR")  # a new window would cover this one
