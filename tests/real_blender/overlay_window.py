# SPDX-License-Identifier: GPL-3.0-or-later
"""Look at results in a window: overlay in the camera view and in an Image Editor, wipe, inspection.

    blender --enable-event-simulate -p 0 0 1500 1100 -P overlay_window.py -- OUT

Writes OUT/overlay.json, a value for each thing that was seen, and screenshots beside it. test_overlay.py judges them.
docs/pictures/overlay.jpg is the viewport in overlay-inspect.png.
"""

import gc
import math
import subprocess
import sys
from pathlib import Path
from weakref import ref

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, PACKAGE, Visit, choose, in_area, modal, module, preferences, result

SIZE = (48, 32)
SAMPLES = ((0.15, 0.5), (0.3, 0.55), (0.7, 0.5), (0.8, 0.6))  # places in the frame, off legends and titles

visit = Visit("overlay")
seen = visit.seen


def build() -> None:
    """Laths before a slab, seen by a camera with shift."""
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0.6, 0), scale=(2.6, 0.1, 2.2))
    for index in range(7):
        bpy.ops.mesh.primitive_cube_add(size=1, location=(-1.2 + 0.4 * index, -0.5, 0), scale=(0.06, 0.06, 2))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.45, location=(0.3, -0.1, -0.3))
    bpy.ops.object.select_all(action="SELECT")
    camera = bpy.data.cameras.new("Eye")
    camera.shift_x, camera.lens = 0.05, 40.0
    eye = bpy.data.objects.new("Eye", camera)
    eye.location, eye.rotation_euler = (0.6, -5.0, 0.9), (math.radians(80), 0.0, 0.1)
    scene = clicks.window().scene
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.resolution_x, scene.render.resolution_y = 960, 640
    choose(resolution="DEPTH", depth=7, size=SIZE, light="two-lights", reference=True)


def shot(name: str):
    """A screenshot, and its file."""
    yield from clicks.screenshot(OUT / f"{name}.png")
    return OUT / f"{name}.png"


def color_at(path: Path, x: float, y: float) -> list[int]:
    """Bytes of the screenshot's pixel at a point of the window, from its lower left."""
    row = clicks.window().height - 1 - int(y)
    done = subprocess.run(
        ["convert", str(path), "-crop", f"1x1+{int(x)}+{row}", "-depth", "8", "rgb:-"], capture_output=True, check=True
    )
    return list(done.stdout[:3])


def compare(path: Path, kind: str, names: tuple[str, str]) -> list[list[list[int]]]:
    """Colours on the screen and in the pictures, at places left and right of the wipe in the middle."""
    view, (rect,) = framed(kind)
    maximum = view.maximum_now(clicks.window().scene.patchnet.heatmap_maximum)
    pictures = [view.picture(name, maximum, "viridis") for name in names]
    return pairs(path, rect, clicks.region("WINDOW", kind), pictures)


def framed(kind: str):
    """View in the largest area of a kind, and its rectangles."""
    return module("overlay.framed").framed(clicks.window().scene, clicks.area(kind), clicks.region("WINDOW", kind))


def pairs(path: Path, rect, region: bpy.types.Region, pictures: list[np.ndarray]) -> list[list[list[int]]]:
    """Colours on the screen and in two pictures, the left and the right one, that lie in a rectangle of a region."""
    found = []
    for share_x, share_y in SAMPLES:
        column, row = int(share_x * SIZE[0]), int(share_y * SIZE[1])
        x = rect.left + (column + 0.5) / SIZE[0] * rect.width + region.x
        y = rect.bottom + (row + 0.5) / SIZE[1] * rect.height + region.y
        value = pictures[share_x > 0.5][row, column]
        found.append([color_at(path, x, y), [round(float(channel) * 255) for channel in value]])
    return found


def into_camera():
    """The viewport looks through the camera, zoomed out a little and moved aside, in solid shading."""
    space = clicks.area("VIEW_3D").spaces.active
    space.shading.type = "SOLID"
    space.show_region_ui = True
    in_area("VIEW_3D", bpy.ops.view3d.view_camera)
    yield 0.5
    space.region_3d.view_camera_zoom, space.region_3d.view_camera_offset = 8.0, (0.04, 0.02)
    yield 0.3
    clicks.region("UI").active_panel_category = "PatchNet"


def in_viewport():
    """Heatmap left, refined right, over the camera's frame."""
    values = bpy.context.window_manager.patchnet_overlay
    values.show_viewport = True
    values.use_wipe, values.wipe, values.picture, values.other = True, 0.5, "HEATMAP", "REFINED"
    path = yield from shot("overlay-viewport")
    seen["viewport"] = compare(path, "VIEW_3D", ("HEATMAP", "REFINED"))
    values.opacity = 0.0
    path = yield from shot("overlay-transparent")
    seen["transparent"] = compare(path, "VIEW_3D", ("HEATMAP", "REFINED"))
    values.opacity = 1.0
    overlay = clicks.area("VIEW_3D").spaces.active.overlay
    overlay.show_overlays = False
    path = yield from shot("overlay-hidden")
    seen["hidden"] = compare(path, "VIEW_3D", ("HEATMAP", "REFINED"))
    overlay.show_overlays = True


def doubled():
    """The same on a screen of twice the resolution, where everything of Blender's is twice as large."""
    space, view = clicks.area("VIEW_3D").spaces.active, bpy.context.preferences.view
    space.show_region_ui, view.ui_scale = False, 2.0
    yield 0.5
    path = yield from shot("overlay-doubled")
    seen["doubled"] = compare(path, "VIEW_3D", ("HEATMAP", "REFINED"))
    space.show_region_ui, view.ui_scale = True, 1.0
    yield 0.5


def inspect():
    """The pixel under the mouse; a right click ends it."""
    inspected, region = module("overlay.overlay_settings").overlay_state().inspected, clicks.region("WINDOW")
    _, (rect,) = framed("VIEW_3D")
    x, y = int(region.x + rect.left + 0.3 * rect.width), int(region.y + rect.bottom + 0.55 * rect.height)
    in_area("VIEW_3D", bpy.ops.patchnet.inspect_pixels, "INVOKE_DEFAULT")
    yield from clicks.move(x, y)
    yield from clicks.move(x + 1, y)
    seen["inspected"] = [pixel.lines for pixel in inspected.values()]
    yield from shot("overlay-inspect")
    yield from clicks.key("RIGHTMOUSE", x, y)
    yield 0.2
    seen["inspection ended"] = not inspected


def unfinished():
    """A job's unfinished picture, in a corner."""
    picture = np.random.default_rng(2).random((SIZE[1], SIZE[0], 3))
    item, region = module("pipeline.unfinished").Unfinished("Eye", "refining, 40%", picture), clicks.region("WINDOW")
    preferences().open_pictures = "WINDOW"
    before = len(bpy.context.window_manager.windows)
    with module("overlay").unfinished_pictures(bpy.context) as meanwhile:
        meanwhile(item)
        path = yield from shot("overlay-unfinished")
        with bpy.context.temp_override(window=clicks.window(), area=clicks.area("VIEW_3D"), region=region):
            rect = module("overlay.open_pictures").inset_rect(bpy.context, picture)
        seen["unfinished"] = pairs(path, rect, region, [picture, picture])
    seen["unfinished windows"] = len(bpy.context.window_manager.windows) - before
    preferences().open_pictures = "NEVER"


def in_image_editor():
    """The same over the picture in an Image Editor."""
    values = bpy.context.window_manager.patchnet_overlay
    clicks.area("VIEW_3D").type = "IMAGE_EDITOR"
    yield 0.3
    space = clicks.area("IMAGE_EDITOR").spaces.active
    space.image = bpy.data.images["PatchNet Eye preview"]
    in_area("IMAGE_EDITOR", bpy.ops.image.view_all, fit_view=True)
    values.show_editor = True
    values.picture, values.other = "REFINED_ERROR", "HEATMAP"
    path = yield from shot("overlay-image")
    seen["image"] = compare(path, "IMAGE_EDITOR", ("REFINED_ERROR", "HEATMAP"))
    scene = clicks.window().scene
    scene.render.engine, scene.cycles.samples, scene.render.resolution_percentage = "CYCLES", 1, 20
    bpy.ops.render.render()
    space.image = bpy.data.images["Render Result"]
    in_area("IMAGE_EDITOR", bpy.ops.image.view_all, fit_view=True)
    path = yield from shot("overlay-render-result")
    seen["render result"] = compare(path, "IMAGE_EDITOR", ("REFINED_ERROR", "HEATMAP"))


def automatic():
    """A preview comes up in an Image Editor that is free, and does not take one that shows something else."""
    space = clicks.area("IMAGE_EDITOR").spaces.active
    own = bpy.data.images.new("Painting", 4, 4)
    space.image = own
    preferences().open_pictures = "EDITOR"
    in_area("IMAGE_EDITOR", bpy.ops.patchnet.render_preview)
    seen["kept"] = space.image.name
    space.image = None
    in_area("IMAGE_EDITOR", bpy.ops.patchnet.render_preview)
    seen["opened"] = space.image.name if space.image else ""
    space.image = own
    preferences().open_pictures = "WINDOW"
    before = len(bpy.context.window_manager.windows)
    in_area("IMAGE_EDITOR", bpy.ops.patchnet.render_preview)
    yield from clicks.wait_for(lambda: len(bpy.context.window_manager.windows) > before, "a window opens")
    yield 0.5
    seen["windows"] = len(bpy.context.window_manager.windows) - before
    new = bpy.context.window_manager.windows[-1]
    shown = [area.spaces.active.image.name for area in new.screen.areas if area.type == "IMAGE_EDITOR"]
    seen["in new window"] = shown
    yield from shot("overlay-window")
    with bpy.context.temp_override(window=new):
        bpy.ops.wm.window_close()
    clicks.area("IMAGE_EDITOR").type = "VIEW_3D"
    yield 0.3


def end():
    """A moved camera is marked; free memory ends all."""
    textures, kept = module("overlay.paint").textures().of_view, module("session.views")
    scene = clicks.window().scene
    session = module("session.scene_session").session_of(scene)
    scene.camera.location.x += 0.3
    yield from shot("overlay-stale")
    seen["stale"] = kept.why_stale(scene, session.views["Eye"])
    seen["drawing"] = [textures.cache_info().currsize > 0, module("overlay.overlay_settings").overlay_state().problem]
    in_area("VIEW_3D", bpy.ops.patchnet.clear_results)
    seen["cleared"] = [textures.cache_info().currsize, bool(session.views)]


def disabled():
    """The extension is disabled while the overlay is drawn and pixels are inspected, and enabled again."""
    in_area("VIEW_3D", bpy.ops.patchnet.run_all)
    bpy.context.window_manager.patchnet_overlay.show_viewport = True
    in_area("VIEW_3D", bpy.ops.patchnet.inspect_pixels, "INVOKE_DEFAULT")
    yield from shot("overlay-before")
    settings, textures = module("overlay.overlay_settings"), ref(module("overlay.paint").textures())
    drawn, state = textures().of_view.cache_info().currsize > 0, ref(settings.overlay_state())
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    yield from clicks.move(*clicks.over_viewport())
    gc.collect()
    kept = hasattr(bpy.types.WindowManager, "patchnet_window")
    seen["disabled"] = {"drawn": drawn, "kept": [kept, state(), textures()], "modal": modal()}
    bpy.ops.preferences.addon_enable(module=PACKAGE)
    yield from shot("overlay-enabled")
    seen["enabled"] = [settings.overlay_state().problem, result() is None]


def session():
    """The whole visit."""
    build()
    yield 0.5
    clicks.window().scene.patchnet.background = "black"  # the world is as gray as the viewport that shows through
    in_area("VIEW_3D", bpy.ops.patchnet.run_all)
    yield from visit.parts(
        into_camera, in_viewport, doubled, inspect, unfinished, in_image_editor, automatic, end, disabled
    )


visit.play(session(), pictures="NEVER")
