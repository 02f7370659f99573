# SPDX-License-Identifier: GPL-3.0-or-later
"""Use the render engine in a window: rendered shading in the viewport, and F12.

    blender --enable-event-simulate -p 0 0 1500 1000 courtyard.blend -P engine_window.py -- OUT

OUT/sky.blend, which test_engine_window.py makes, is opened last, and rendered at once.
Writes OUT/engine.json, a value for each thing that was seen. test_engine_window.py judges it.
"""

import os
import signal
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, Visit, choose, ends_of_renders, engine, made, module, watched

visit = Visit("engine")
seen = visit.seen


def show(mode: str) -> None:
    """Shading mode of the 3D viewport."""
    clicks.area("VIEW_3D").spaces.active.shading.type = mode


def settle(viewport, what: str, seconds: float = 120.0):
    """Wait until the preview of a viewport has spent its budget; how often it was drawn different meanwhile."""
    yield from clicks.wait_for(lambda: viewport._preview is not None and viewport._preview.done, what, seconds)


def preview():
    """Refining while the view stands still, starting anew when it moves, done in the end."""
    show("RENDERED")
    viewports: list = []
    watched(viewports)
    choose(resolution="DEPTH", depth=7, scope="VISIBLE", light="two-lights")
    choose(color=True, budget=0.005, refined_samples=1024.0, render_samples=0.0)
    made("voxelize", "bake_light", "precompute_codes")
    yield from clicks.wait_for(lambda: viewports and viewports[-1]._preview is not None, "a preview begins", 180.0)
    viewport = viewports[-1]
    first, engines = viewport._preview, len(viewports)
    yield from clicks.wait_for(lambda: first.pixels is not None, "a picture")
    seen["coarse at first"] = not first.pixels.traced
    yield from clicks.wait_for(lambda: first.pixels.traced, "every pixel is traced")
    yield from sky(viewport)  # looks at it make Blender begin new engines
    seen["begun anew"] = len(viewports) - engines + (viewport._preview is not first)
    x, y = clicks.over_viewport()
    yield from clicks.move(x, y)
    clicks.window().event_simulate(type="WHEELUPMOUSE", value="PRESS", x=x, y=y)
    yield from clicks.wait_for(lambda: viewport._preview is not first, "another view is another preview")
    yield from settle(viewport, "the preview spends its budget")
    samples = viewport._preview.pixels.samples
    seen["finest"], seen["refined share"] = int(samples.max()), float((samples == 1024).mean())
    first = None
    yield from engine_ended(viewport)
    yield from masks(viewport)
    show("SOLID")
    for _ in range(20):  # kept for another engine for a moment, longer where the machine is busy
        yield 1.0
        seen["references left"] = sys.getrefcount(viewports[-1])
        if seen["references left"] == 3:
            break


def sky(viewport):
    """The courtyard's world, a gradient, stands behind all objects as soon as a timer has made its map."""
    session = module("session.scene_session").session_of(clicks.window().scene)
    yield from clicks.wait_for(lambda: session.world is not None, "the world's map")
    yield from clicks.wait_for(lambda: viewport._background == session.world.key, "a sky")
    yield from settle(viewport, "the preview with a sky spends its budget")
    pixels = viewport._preview.pixels
    beside = pixels.values[:, 3] == 0.0
    light = pixels.shown.reshape(-1, 4)[beside, :3]
    seen["sky"] = {"share": float(beside.mean()), "least": float(light.min()), "spread": float(light.std(axis=0).max())}


def engine_ended(viewport):
    """The engine process ends while it works on a picture, as another job's stop may end it."""
    first = viewport._preview
    x, y = clicks.over_viewport()
    clicks.window().event_simulate(type="WHEELDOWNMOUSE", value="PRESS", x=x, y=y)
    yield from clicks.wait_for(lambda: viewport._preview is not first, "a preview begins")
    begun, pid = viewport._preview, engine("process.computed").engine_pid()
    if pid is not None:
        os.kill(pid, signal.SIGKILL)
        yield from clicks.wait_for(lambda: viewport._preview is not begun, "a preview begins anew", 30.0)
    yield from settle(viewport, "the preview after the engine's end")
    seen["refined after the engine's end"] = int(viewport._preview.pixels.samples.max())


def masks(viewport):
    """Through the camera: a mask that is white on the left of its picture, then on the right, then a vertex group."""
    scene = clicks.window().scene
    clicks.area("VIEW_3D").spaces.active.region_3d.view_perspective = "CAMERA"
    image = bpy.data.images.new("Mask", 128, 64)
    paint(image, slice(0, 64))
    scene.patchnet.budget = 0.001
    choose_mask(importance="IMAGE", importance_image="Mask")
    yield from settle_masked(viewport, "left")
    paint(image, slice(64, 128))
    clicks.area("VIEW_3D").tag_redraw()
    yield from settle_masked(viewport, "right")
    wall = scene.objects["Back wall"]
    wall.modifiers.new("Smooth", "SUBSURF").render_levels = 2  # one in viewports
    wall.vertex_groups.new(name="Matters").add(range(len(wall.data.vertices)), 1.0, "REPLACE")
    yield 0.5
    seen["levels before"] = wall.modifiers["Smooth"].levels
    choose_mask(importance="VERTEX_GROUP", importance_group="Matters")
    yield from settle_masked(viewport, "group")
    seen["levels after"] = wall.modifiers["Smooth"].levels
    wall.vertex_groups["Matters"].add(range(len(wall.data.vertices)), 0.5, "REPLACE")
    wall.data.update_tag()
    yield from settle_masked(viewport, "lighter group")
    wall.modifiers.clear()
    choose_mask(importance_group="Nobody")
    yield 1.0
    scene.patchnet.importance = "NONE"


def choose_mask(**values: str) -> None:
    """Set settings as buttons do, which tell the scene."""
    choose(**values)
    clicks.window().scene.update_tag()


def paint(image: bpy.types.Image, columns: slice) -> None:
    """These columns white, the others black."""
    pixels = np.zeros((image.size[1], image.size[0], 4), np.float32)
    pixels[..., 3] = 1.0
    pixels[:, columns, :3] = 1.0
    image.pixels.foreach_set(pixels.ravel())


def settle_masked(viewport, name: str):
    """Wait for the preview that another mask is the reason for: where it refined, and what it thinks of pixels."""
    before = viewport._preview
    yield from clicks.wait_for(
        lambda: viewport._preview not in (None, before) and viewport._preview.done, f"a preview with mask {name}"
    )
    pixels, width = viewport._preview.pixels, viewport._preview.camera.width_px
    columns = np.flatnonzero(pixels.samples > 1) % width
    seen[f"mask {name}"] = {
        "columns": [float(columns.min() / width), float(columns.max() / width)],
        "heaviest": float(pixels.importance.max()),
        "matter": float((pixels.importance > 0).mean()),
    }


def final_renders():
    """F12 in a job of Blender's own, beside a window that lives, with voxels and without.

    Blender's jobs hear Esc from the window system only, not from events that are simulated: see escape_window.py.
    """
    scene = clicks.window().scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 320, 200, 100
    yield from rendered("render")
    yield 0.5
    seen["windows"] = [[area.type for area in window.screen.areas] for window in bpy.context.window_manager.windows]
    scene.patchnet.light = "cycles"  # which no render beside a window can bake
    scene.objects["Back wall"].location.z += 0.01
    yield 0.5
    frame, said = module("render_engine.render_frame"), []
    warn = frame.warn
    frame.warn = lambda renderer, text: (said.append(text), warn(renderer, text))
    yield from rendered("render of old voxels")
    seen["said of old voxels"] = said
    bpy.ops.patchnet.clear_results()
    yield from rendered("render without voxels")


def rendered(name: str) -> clicks.Session:
    """Press F12 and wait until the job ends; how it ended."""
    ended = ends_of_renders()
    yield from clicks.key("F12", *clicks.over_viewport())
    yield from clicks.wait_for(lambda: bool(ended) or bpy.app.is_job_running("RENDER"), f"{name} starts")
    yield from clicks.wait_for(lambda: bool(ended) and not bpy.app.is_job_running("RENDER"), f"{name} ends")
    seen[name] = ended[-1]


def sky_at_once():
    """In a file that has just been opened, F12 and all frames of an animation: the world is another one in each."""
    bpy.ops.wm.open_mainfile(filepath=str(OUT / "sky.blend"))
    yield 0.1
    yield from rendered("sky at once")
    bpy.data.images["Render Result"].save_render(str(OUT / "sky-at-once.exr"))
    scene = clicks.window().scene
    scene.render.filepath = str(OUT / "sky-window-")
    ended = ends_of_renders()
    with bpy.context.temp_override(window=clicks.window()):
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
    yield from clicks.wait_for(lambda: bool(ended) and not bpy.app.is_job_running("RENDER"), "the animation ends")


def session():
    """The whole visit."""
    clicks.window().scene.render.engine = "PATCHNET"
    yield from visit.parts(preview, final_renders, sky_at_once)


visit.play(session())
