# SPDX-License-Identifier: GPL-3.0-or-later
"""Kill Blender after a bake, open the file again, and continue without a bake.

    blender --enable-event-simulate -p 0 0 1000 800 yard.blend -P reload_window.py -- OUT made
    blender --enable-event-simulate -p 0 0 1000 800 OUT/reload.blend -P reload_window.py -- OUT opened

Writes OUT/made.json and OUT/opened.json, a value for each thing that was seen. test_reload.py judges them.
"""

import os
import signal
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import (
    OUT,
    Heard,
    Visit,
    choose,
    ends_of_renders,
    module,
    open_tab,
    press,
    render,
    result,
    running,
    side_box,
)

SMALL = {"scope": "VISIBLE", "resolution": "DEPTH", "depth": 6, "size": (96, 64), "cameras": "Far", "max_samples": 2}

name = sys.argv[-1]
visit = Visit(name)
seen = visit.seen
heard = Heard()


def told() -> dict[str, object]:
    """Sentences of the panel about the voxels, and what of them is stale."""
    kept = result()
    return {"voxels": kept.octree.leaf_count, "codes": len(kept.coded.codes), "stale": sorted(kept.stale)}


def pictures() -> list[str]:
    """Our images that show something."""
    return [image.name for image in bpy.data.images if image.name.startswith("PatchNet ") and image.has_data]


def run(job: str) -> clicks.Session:
    """Press a button of the sidebar, and wait until its job is over; labels of the steps that it took."""
    heard.begun.clear()
    heard.labels.clear()
    press(job)
    yield from clicks.wait_for(lambda: bool(heard.begun), "the job starts")
    yield from clicks.wait_for(lambda: not running(), "the job ends", 300.0)
    yield 0.5
    return list(heard.labels)


def could_move(scene: bpy.types.Scene) -> None:
    """Keyframes of one value, nodes that change nothing, and a camera that moves."""
    lath = scene.objects["Lath 2"]
    lath.keyframe_insert("location", frame=1)
    lath.keyframe_insert("location", frame=3)
    nodes = bpy.data.node_groups.new("Same", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        nodes.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    nodes.links.new(nodes.nodes.new("NodeGroupInput").outputs[0], nodes.nodes.new("NodeGroupOutput").inputs[0])
    scene.objects["Floor"].modifiers.new("Same", "NODES").node_group = nodes
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    scene.collection.objects.link(other)
    other.keyframe_insert("location", frame=1)
    other.location.x = 1.0
    other.keyframe_insert("location", frame=3)
    scene.frame_end = 3


def made() -> clicks.Session:
    """Save, then preview everything with Cycles' light, then die without saving."""
    could_move(clicks.window().scene)
    choose(**SMALL)
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / "reload.blend"))
    yield 0.3
    seen["steps"] = yield from run("run_all")
    seen["told"] = told()
    writing = module("session.octree_cache")._writing
    yield from clicks.wait_for(lambda: not writing(), "the octree is kept")
    visit.save("made")
    os.kill(os.getpid(), signal.SIGKILL)


def opened() -> clicks.Session:
    """The voxels are there; Render Preview brings the pictures, F12 renders; so they are when the file is reverted."""
    yield from clicks.wait_for(lambda: result() is not None, "the voxels come back", 60.0)
    seen["told"] = told()
    seen["pictures at first"] = pictures()
    yield from open_tab()
    yield from clicks.screenshot(OUT / "panel-reloaded.png", side_box())
    seen["steps of the preview"] = yield from run("render_preview")
    seen["pictures"] = len(pictures())
    visit.save("preview")
    clicks.window().scene.frame_set(2)
    yield 1.5  # voxels are compared after a pause
    seen["told at another frame"] = told()
    seen["steps at another frame"] = yield from run("run_all")
    yield from rendered()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.revert_mainfile()
    yield from clicks.wait_for(lambda: result() is not None, "the voxels come back", 60.0)
    seen["told when reverted"] = told()


def rendered() -> clicks.Session:
    """F12, with the voxels that came back."""
    ended, octree = ends_of_renders(), result().octree
    render(96, 64)
    yield from clicks.wait_for(lambda: bool(ended), "the render ends", 120.0)
    yield 0.5
    seen["render"] = {"ended": ended, "same voxels": result().octree is octree}


visit.play({"made": made, "opened": opened}[name](), pictures="EDITOR")
