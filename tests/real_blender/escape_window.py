# SPDX-License-Identifier: GPL-3.0-or-later
"""Press F12, then Esc, then F12 with a painted mask, with keys from the window system.

    blender -p 0 0 1500 1000 courtyard.blend -P escape_window.py -- OUT

Writes OUT/escape.json, a value for each thing that was seen, and the renders' passes beside it.
"""

import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import clicks
import x_keys
from visits import OUT, Visit, choose, ends_of_renders, made, module, render

SIZE = 960, 540  # minutes of work, where all pixels are refined

visit = Visit("escape")
seen = visit.seen
ended = ends_of_renders()
pictures: list = []


def prepare() -> clicks.Session:
    """Voxels, a picture that would take minutes, and a note of how each render ends."""
    choose(resolution="DEPTH", depth=6, scope="VISIBLE", light="two-lights")
    choose(color=True, strategy="ss-variance", refined_samples=1024.0, render_samples=0.0)
    made("voxelize", "bake_light", "precompute_codes")
    yield 0.1
    settings = clicks.window().scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "32", "NONE"
    output = module("render_engine.render_frame")._Output
    take = output._take

    def taken(self, pixels):
        pictures.append(pixels)
        take(self, pixels)

    output._take = taken


def begin(width: int, height: int) -> None:
    """Start a render."""
    ended.clear()
    pictures.clear()
    render(width, height)


def escape(name: str) -> clicks.Session:
    """Press Esc and wait for the render's end; how it ended, and how long that took."""
    start = time.monotonic()
    seen["keys went to"] = x_keys.press(x_keys.ESCAPE)
    yield from clicks.wait_for(over, f"{name}: the render ends")
    seen[name] = {"ended": list(ended), "seconds": round(time.monotonic() - start, 2)}


def over() -> bool:
    """See that no render runs any more."""
    return bool(ended) and not bpy.app.is_job_running("RENDER")


def keep(name: str) -> None:
    """The passes that Blender has now."""
    bpy.data.images["Render Result"].save_render(str(OUT / f"{name}.exr"))


def stop_refining() -> clicks.Session:
    """Esc while pixels are refined: what was refined by then stays."""
    choose(budget=1.0)
    begin(*SIZE)
    yield from clicks.wait_for(lambda: pictures and bool((pictures[0].samples == 1024).any()), "pixels are refined")
    yield from escape("stopped")
    keep("escape-stopped")
    np.save(OUT / "escape-samples.npy", pictures[0].samples.reshape(SIZE[::-1]))


def render_with_mask() -> clicks.Session:
    """A small one to its end, with a mask that is white on the left."""
    choose(budget=0.1)
    image = bpy.data.images.new("Mask", 64, 32)
    pixels = np.ones((32, 64, 4), np.float32)
    pixels[:, 32:, :3] = 0.0
    image.pixels.foreach_set(pixels.ravel())
    choose(importance="IMAGE", importance_image="Mask")
    begin(96, 54)
    yield from clicks.wait_for(over, "the render with a mask ends")
    seen["image"] = list(ended)
    keep("escape-image")


def session() -> clicks.Session:
    """The whole visit."""
    clicks.window().scene.render.engine = "PATCHNET"
    yield from visit.parts(prepare, stop_refining, render_with_mask)


visit.play(session())
