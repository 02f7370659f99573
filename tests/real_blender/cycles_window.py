# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine with Cycles in a window: by the button, and with Esc in the middle.

    blender --enable-event-simulate -p 0 0 1500 1100 -P cycles_window.py -- OUT button
    blender -p 0 0 1500 1100 -P cycles_window.py -- OUT escape

Writes OUT/cycles-button.json or OUT/cycles-escape.json, a value for each thing that was seen. test_cycles_window.py
judges them.
"""

import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(1, str(Path(__file__).parents[1] / "blender"))
import clicks
import scene_snapshot
import x_keys
from visits import OUT, Visit, choose, ends_of_renders, made, module, open_panels, open_tab, running, tabs

PART = sys.argv[-1]
SIZE = (48, 32)
SETTINGS = {"resolution": "DEPTH", "depth": 7, "scope": "VISIBLE", "size": SIZE, "max_samples": 2, "cameras": "Eye"}
CYCLES = {"budget": 0.2, "samples": 512, "compare": True}
FEW, MANY = 16, 65536  # samples: a second or two for a region of one tile, half a minute for the whole picture
THIRD = 3  # render: after the pixel with which Cycles reads the scene, and the region

visit = Visit(f"cycles-{PART}")
seen = visit.seen
begun: list[str] = []
ended = ends_of_renders()
watch = {"ticks": 0, "draws": 0, "fractions": set()}


def build() -> None:
    """Laths before a slab, a marker that gives the frame to another camera."""
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0.6, 0), scale=(2.6, 0.1, 2.2))
    for index in range(5):
        bpy.ops.mesh.primitive_cube_add(size=1, location=(-1.0 + 0.5 * index, -0.5, 0), scale=(0.06, 0.06, 2))
    scene = clicks.window().scene
    for name, turned in (("Eye", 90), ("Elsewhere", 0)):
        eye = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        eye.location, eye.rotation_euler = (0.4, -5.0, 0.3), (math.radians(turned), 0.0, 0.05)
        scene.collection.objects.link(eye)
    scene.camera = bpy.data.objects["Eye"]
    choose(**SETTINGS, **{f"cycles_{name}": value for name, value in CYCLES.items()})
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    scene.render.resolution_x, scene.render.resolution_y = 48, 32


def prepare() -> clicks.Session:
    """Voxels with light and codes, a render of the user's own, edit mode."""
    tempfile.tempdir = str(OUT / f"cycles-{PART}-temp")
    Path(tempfile.tempdir).mkdir()
    build()
    yield 0.2
    with bpy.context.temp_override(window=clicks.window(), area=clicks.area("VIEW_3D")):
        made("voxelize", "bake_light", "precompute_codes")
        bpy.ops.render.render()
        clicks.window().scene.timeline_markers.new("Cut", frame=1).camera = bpy.data.objects["Elsewhere"]
        bpy.ops.object.mode_set(mode="EDIT")
    bpy.app.handlers.render_init.append(lambda *_: begun.append("render"))
    ended.clear()  # of the user's own
    bpy.types.SpaceView3D.draw_handler_add(drawn, (), "WINDOW", "POST_PIXEL")
    yield 0.2


def drawn() -> None:
    """The viewport is drawn."""
    watch["draws"] += bpy.app.is_job_running("RENDER")


def watched(until) -> clicks.Session:
    """Let the window live until a condition holds, and count how it does while Blender renders."""
    watch.update(ticks=0, draws=0, fractions=set())
    while not until():
        if bpy.app.is_job_running("RENDER"):
            watch["ticks"] += 1
            job = module("jobs.job_operator").job_in_window().display
            watch["fractions"].add(round(job.whole or 0.0, 6) if job else 0.0)
            if watch["ticks"] % 10 == 0:  # without a graphics card drawing takes longer than all else
                clicks.area("VIEW_3D").tag_redraw()
        yield 0.02


def state() -> dict[str, object]:
    """The whole file without our pictures, what the user rendered, and what else a render could change."""
    for image in [image for image in bpy.data.images if image.get("patchnet_result")]:
        bpy.data.images.remove(image)
    for image in bpy.data.images:
        len(image.pixels)  # a viewer's image is there once a caller has asked
    own = OUT / f"cycles-{PART}-own.png"
    bpy.data.images["Render Result"].save_render(str(own))
    view = bpy.context.preferences.view
    windows = [[area.type for area in window.screen.areas] for window in bpy.context.window_manager.windows]
    values = [view.render_display_type, bpy.context.preferences.is_dirty, windows, own.read_bytes()]
    return scene_snapshot.scene_snapshot() | {"beside": {str(index): value for index, value in enumerate(values)}}


def pixels() -> dict[str, bytes]:
    """Our pictures by Cycles."""
    result = {}
    for name in ("cycles", "cycles full", "cycles error", "cycles mask"):
        image = bpy.data.images[f"PatchNet Eye {name}"]
        values = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(values)
        result[name] = values.tobytes()
    return result


def differences(before: dict[str, object]) -> list[str]:
    """Find what is not as before, but for lists of reports and of operators that ran."""
    found = scene_snapshot._differences(before, state(), "")
    return [text[:300] for text in found if "[WinMan]" not in text]


def by_button() -> clicks.Session:
    """The button of the panel, then the same from a script, which waits for it."""
    area = clicks.area("VIEW_3D")
    keep = {"PATCHNET_PT_main", "PATCHNET_PT_cycles_refine"}
    open_panels(keep)
    yield from open_tab()
    buttons = yield from clicks.find_buttons({"patchnet.refine_with_cycles"})
    before = state()
    yield from clicks.click(buttons["patchnet.refine_with_cycles"])
    yield from clicks.wait_for(lambda: bool(running()), "the button starts")
    yield from watched(lambda: not running())
    seen["button"] = {"ended": list(ended), "ticks": watch["ticks"], "draws": watch["draws"]}
    beside = pixels()
    seen["in overlay"] = module("session.scene_session").session_of(clicks.window().scene).views["Eye"].has("CYCLES")
    yield from clicks.screenshot(OUT / "cycles-button.png")
    seen["changed"] = differences(before)
    with bpy.context.temp_override(window=clicks.window(), area=area):
        seen["script"] = sorted(bpy.ops.patchnet.refine_with_cycles())
    seen["same pixels"] = {name: values == beside[name] for name, values in pixels().items()}
    for item in [each for each in tabs() if each.__name__ not in keep]:
        bpy.utils.register_class(item)


def refine() -> None:
    """Call what the button calls."""
    for words in (begun, ended):
        words.clear()
    with bpy.context.temp_override(window=clicks.window(), area=clicks.area("VIEW_3D")):
        bpy.ops.patchnet.refine_with_cycles("INVOKE_DEFAULT")


def lively() -> bool:
    """See that the window is drawn and progress moves while Blender renders, again and again."""
    return watch["draws"] > 3 and watch["ticks"] > 5 and len(watch["fractions"]) > 3


def with_escape() -> clicks.Session:
    """To the end, stopped in the whole picture, to the end again."""
    values = clicks.window().scene.patchnet
    values.cycles_samples = FEW
    refine()
    yield from watched(lambda: not running())
    first = pixels()
    values.cycles_samples, values.cycles_budget = MANY, 0.05
    before = state()
    refine()
    yield from clicks.wait_for(lambda: len(begun) == THIRD or not running(), "the whole picture begins", 90.0)
    yield from watched(lambda: not running() or lively())
    seen["whole"] = {"running": running(), "ended": ended[2:], "fractions": sorted(watch["fractions"])[:5]}
    seen["keys went to"] = x_keys.press(x_keys.ESCAPE)
    yield from clicks.wait_for(lambda: not running(), "Esc stops it")
    seen["stopped"] = {"ended": ended[2:], "job": bpy.app.is_job_running("RENDER"), "renders": len(begun)}
    seen["changed"] = differences(before)
    values.cycles_samples, values.cycles_budget = FEW, CYCLES["budget"]
    refine()
    yield from watched(lambda: not running())
    seen["again"] = {"ended": list(ended), "same pixels": pixels() == first}


def session() -> clicks.Session:
    """The whole visit."""
    yield from prepare()
    yield from by_button() if PART == "button" else with_escape()
    left = [path.name for path in Path(tempfile.tempdir).iterdir()]
    seen["left in the folder for temporary files"] = [name for name in left if not name.startswith("patchnet-engine-")]


visit.play(session(), pictures="NEVER")
