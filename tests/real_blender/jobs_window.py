# SPDX-License-Identifier: GPL-3.0-or-later
"""Use Blender during a job: save, open menus, edit, undo, render.

    blender --enable-event-simulate -p 0 0 1000 800 courtyard.blend -P jobs_window.py -- OUT

Writes OUT/jobs.json, a value for each thing that was seen. test_jobs_window.py judges them.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, Heard, Visit, baking, choose, ends_of_renders, modal, module, press, result, running
from visits import render as press_f12

SMALL = {"scope": "VISIBLE", "resolution": "DEPTH", "depth": 6, "size": (48, 32), "cameras": "Far", "budget": 0.1}
LONG = 65536  # samples of a bake that takes many minutes

visit = Visit("jobs")
seen = visit.seen
heard = Heard()


def start(samples: int) -> clicks.Session:
    """Start a job as its button does, and wait until Cycles bakes."""
    yield from baking(samples)
    yield 0.3


def stop() -> clicks.Session:
    """Press Esc."""
    yield from clicks.key("ESC", *clicks.over_viewport())
    yield from clicks.wait_for(lambda: not running(), "Esc stops the job")
    yield from clicks.wait_for(lambda: not bpy.app.is_job_running("OBJECT_BAKE"), "Cycles stops")
    yield 0.3


def prepare() -> clicks.Session:
    """Small settings, and a picture of the user's own in an Image Editor."""
    choose(**SMALL)
    editor = clicks.area("OUTLINER")
    editor.type = "IMAGE_EDITOR"
    editor.spaces.active.image = bpy.data.images.new("Mine", 16, 16)
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / "jobs.blend"))
    yield 0.3


def shown() -> str | None:
    """Image in the user's Image Editor."""
    image = clicks.area("IMAGE_EDITOR").spaces.active.image
    return image and image.name


def use_blender_meanwhile() -> clicks.Session:
    """Ctrl-S, the File menu, a key that would move an object, during a bake."""
    window, (x, y), file = clicks.window(), clicks.over_viewport(), OUT / "jobs.blend"
    yield from start(LONG)
    times = [file.stat().st_mtime_ns]
    yield from clicks.key("S", x, y, ctrl=True)
    yield 0.5
    times.append(file.stat().st_mtime_ns)
    (OUT / "jobs-saved.blend").write_bytes(file.read_bytes())
    yield from clicks.click((55, window.height - 10))  # File; S is the letter of Save in it
    yield 0.5
    yield from clicks.key("S", 55, window.height - 60)
    yield 0.5
    times.append(file.stat().st_mtime_ns)
    seen["saves"] = len(set(times)) - 1
    item = window.scene.objects["Back wall"]
    window.view_layer.objects.active = item
    item.select_set(True)
    before = tuple(item.location)
    yield from clicks.key("G", x, y)
    yield from clicks.move(x + 50, y + 50)
    yield from clicks.key("LEFTMOUSE", x + 50, y + 50)
    seen["grabbed"] = tuple(item.location) != before
    seen["meanwhile"] = {"running": running(), "shown": shown()}
    yield from stop()
    seen["stopped"] = {"running": running(), "shown": shown(), "modal": modal()}


def escape_at_once() -> clicks.Session:
    """Esc as the first event after Cycles began, which the bake of Blender itself takes."""
    choose(max_samples=LONG, noise_threshold=0.0001)
    press("run_all")
    while not bpy.app.is_job_running("OBJECT_BAKE"):
        yield 0.0
    yield from stop()
    seen["at once"] = {"running": running(), "modal": modal()}


def stop_button() -> clicks.Session:
    """Blender's own stop button, in the status bar beside the progress of its bake."""
    yield from start(LONG)
    share = module("jobs.job_operator").job_in_window().display
    yield from clicks.wait_for(lambda: share.progress.label == "Refining light, round 4", "a long round begins", 240.0)
    yield from clicks.wait_for(lambda: bpy.app.is_job_running("OBJECT_BAKE"), "Cycles bakes")
    yield 1.0
    told = len(heard.told)
    for x in range(600, 640, 7):
        yield from clicks.key("LEFTMOUSE", x, 11)
    yield from clicks.wait_for(lambda: not running(), "the button stops the job", 15.0)
    seen["button"] = {"told": heard.told[told:], "modal": modal()}


def edit_meanwhile() -> clicks.Session:
    """A script changes what is baked: the job ends with a sentence, and keeps no light of a scene that is none."""
    yield from start(LONG)
    watch = module("state.watch").change_monitor()
    clicks.window().scene.objects["Sun"].rotation_euler.x += 0.1
    yield from clicks.wait_for(lambda: not running(), "the job ends", 60.0)
    yield 0.3
    seen["edited"] = {
        "edited": watch.edited,
        "told": heard.told[-1:],
        "result": result() is not None and not result().unfinished,
        "modal": modal(),
    }
    clicks.window().scene.objects["Sun"].rotation_euler.x -= 0.1
    yield 0.3


def undo_meanwhile() -> clicks.Session:
    """An undo ends the job, and takes nothing else."""
    bpy.ops.ed.undo_push(message="before")
    clicks.window().scene.objects["Back wall"].location.z += 0.1
    bpy.ops.ed.undo_push(message="moved")
    names = sorted(item.name for item in clicks.window().scene.objects)
    yield from start(64)
    bpy.ops.ed.undo()
    yield from clicks.wait_for(lambda: not bpy.app.is_job_running("OBJECT_BAKE"), "Cycles stops")
    yield from clicks.move(*clicks.over_viewport())  # the next event ends what is left of operators
    yield 0.5
    after = sorted(item.name for item in clicks.window().scene.objects)
    seen["undone"] = {"running": running(), "modal": modal(), "same": after == names}


def resume() -> clicks.Session:
    """Esc after the first round; the next job goes on there."""
    clicks.window().scene.objects["Sun"].data.energy *= 1.1  # of which no light is there
    yield from start(LONG)
    share = module("jobs.job_operator").job_in_window().display
    yield from clicks.wait_for(lambda: share.progress.label.startswith("Refining light"), "the first round ends", 240.0)
    yield from stop()
    heard.begun.clear()
    heard.labels.clear()
    choose(max_samples=64)
    press("run_all")
    yield from clicks.wait_for(lambda: bool(heard.begun), "the job starts")
    yield from clicks.wait_for(lambda: not running(), "the job ends", 240.0)
    seen["resumed"] = [label for label in heard.labels if label.startswith("Resuming")]


def reports() -> clicks.Session:
    """Blender's report at the end of each bake call is not shown."""
    editor = clicks.area("PROPERTIES")
    editor.type = "INFO"
    editor.spaces.active.show_report_info = True
    yield 0.3
    with bpy.context.temp_override(window=clicks.window(), area=editor, region=clicks.region("WINDOW", "INFO")):
        bpy.ops.info.select_all(action="SELECT")
        bpy.ops.info.report_copy()
    editor.type = "PROPERTIES"
    lines = bpy.context.window_manager.clipboard.splitlines()
    seen["reports"] = lines
    yield 0.3


def after_the_job() -> clicks.Session:
    """Pictures come up in a window of their own; nothing of the job is left in the other one."""
    yield from clicks.wait_for(lambda: len(bpy.context.window_manager.windows) == 2, "the heatmap comes up")
    yield 0.5
    for kind in ("MOUSEMOVE", "ESC"):
        for window in bpy.context.window_manager.windows:
            window.event_simulate(type=kind, value="NOTHING" if kind == "MOUSEMOVE" else "PRESS", x=300, y=300)
            yield 0.1
    seen["ended"] = {"modal": modal(), "shown": shown(), "stale": dict(result().reasons)}
    view, windows = clicks.area("VIEW_3D"), bpy.context.window_manager.windows
    seen["new window"] = {"width": windows[1].width, "height": windows[1].height, "view": [view.width, view.height]}
    seen["stopped with"] = [text for text in heard.told if text.startswith("Stopped")]


def render() -> clicks.Session:
    """F12 uses the voxels that are there."""
    octree, ended = result().octree, ends_of_renders()
    press_f12(48, 32)
    yield from clicks.wait_for(lambda: bool(ended), "the render ends")
    yield 0.5
    bpy.data.images["Render Result"].save_render(str(OUT / "jobs-render.png"))
    image = bpy.data.images.load(str(OUT / "jobs-render.png"))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    mean = float(pixels.reshape(-1, 4)[:, :3].mean())
    seen["render"] = {"ended": list(ended), "mean": mean, "same voxels": result().octree is octree}


def fly_through() -> clicks.Session:
    """Bake Fly-Through: one bake beside the window, then Blender's own render of the frames."""
    scene, folder = clicks.window().scene, OUT / "film"
    scene.frame_start, scene.frame_end, scene.render.filepath = 1, 3, f"{folder}/"
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "CYCLES", 64, 48
    for frame, x in ((1, 0.0), (3, 0.4)):
        scene.camera.delta_location.x = x
        scene.camera.keyframe_insert("delta_location", frame=frame)
    choose(resolution="AUTO", max_samples=2, noise_threshold=0.5)
    before = ends_of_renders()
    press("fly_through")
    last = folder / "0003.png"
    yield from clicks.wait_for(last.is_file, "the last frame", 240.0)
    yield from clicks.wait_for(lambda: scene.render.engine == "CYCLES", "the engine is back")
    yield 1.0
    files = sorted(path.name for path in folder.iterdir())
    seen["film"] = {"files": files, "ended": before[-1:], "engine": scene.render.engine, "modal": modal()}
    seen["film"] |= {
        "track": scene.patchnet.track,
        "estimate": module("session.scene_session").session_of(scene).estimate.lines,
    }
    times = [path.stat().st_mtime_ns for path in sorted(folder.iterdir())]
    press("fly_through")
    yield 2.0
    seen["film"]["again"] = times == [path.stat().st_mtime_ns for path in sorted(folder.iterdir())]


PARTS = (
    prepare,
    use_blender_meanwhile,
    escape_at_once,
    stop_button,
    edit_meanwhile,
    undo_meanwhile,
    resume,
    reports,
    after_the_job,
    render,
    fly_through,
)
visit.play(visit.parts(*PARTS), pictures="WINDOW")
