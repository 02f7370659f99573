# SPDX-License-Identifier: GPL-3.0-or-later
"""Screenshots of PatchNet in a Blender window, for the documentation; make_screens.py starts it.

    blender --enable-event-simulate -p 0 0 1400 900 -P screens.py -- OUT [PART ...]

Adds the demo scene, previews it, and writes OUT/*.png; OUT/screens.txt has the traceback of an error, or "". PARTs are
functions of this file, by default all of `PARTS`.
"""

import sys
from pathlib import Path

import bpy  # noqa: TID251

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "real_blender"))
import clicks  # noqa: E402
import visits  # noqa: E402
from visits import OUT, in_area  # noqa: E402

SETTINGS = {"size": (192, 192)}
JOB_S = 900.0  # limit, for a busy machine
CAMERA = "Middle"
SIDE_PX = 320
# All overlays of the viewport except PatchNet's.
HELPERS = (
    "show_floor", "show_ortho_grid", "show_axis_x", "show_axis_y", "show_cursor", "show_text", "show_stats",
    "show_extras", "show_relationship_lines", "show_outline_selected", "show_bones", "show_motion_paths",
    "show_object_origins",
)  # fmt: skip


def box(item) -> tuple[int, int, int, int]:
    """Box of an area or region, for screenshots."""
    return item.x, item.y, item.width, item.height


def widen_sidebar():
    """Drag the sidebar's edge, as a user does, until its labels fit."""
    side = clicks.region("UI")
    x, y = side.x, side.y + side.height // 3
    target = side.x + side.width - SIDE_PX
    window = clicks.window()
    yield from clicks.move(x, y)
    window.event_simulate(type="LEFTMOUSE", value="PRESS", x=x, y=y)
    yield 0.2
    for step in range(1, 6):
        yield from clicks.move(x + (target - x) * step // 5, y)
    window.event_simulate(type="LEFTMOUSE", value="RELEASE", x=target, y=y)
    yield 0.5


def open_scene():
    """Open the demo scene, its camera and the sidebar's tab."""
    in_area("VIEW_3D", bpy.ops.patchnet.add_demo_scene)
    yield 0.5
    scene = clicks.window().scene
    scene.camera = scene.objects[CAMERA]
    for name, value in SETTINGS.items():
        setattr(scene.patchnet, name, value)
    space = clicks.area("VIEW_3D").spaces.active
    space.shading.type, space.shading.color_type = "SOLID", "TEXTURE"
    for name in HELPERS:
        setattr(space.overlay, name, False)
    if space.region_3d.view_perspective != "CAMERA":  # the demo scene may open in it
        in_area("VIEW_3D", bpy.ops.view3d.view_camera)
    space.show_region_ui = True
    yield 0.5
    clicks.region("UI").active_panel_category = "PatchNet"
    yield 0.5
    yield from widen_sidebar()
    in_area("VIEW_3D", bpy.ops.view3d.view_center_camera)
    yield 0.3


def preview():
    """Estimate, run all stages and compare, with a screenshot during the bake."""
    visits.preferences().open_pictures = "NEVER"
    in_area("VIEW_3D", bpy.ops.patchnet.estimate)
    in_area("VIEW_3D", bpy.ops.patchnet.run_all, "INVOKE_DEFAULT")
    yield from clicks.wait_for(lambda: bpy.app.is_job_running("OBJECT_BAKE"), "Cycles bakes", JOB_S)
    yield 2.0
    yield from clicks.screenshot(OUT / "window-progress.png")
    yield from clicks.wait_for(lambda: not visits.running(), "the preview is made", JOB_S)
    yield 0.5
    in_area("VIEW_3D", bpy.ops.patchnet.compare, "INVOKE_DEFAULT")
    yield 0.5
    yield from clicks.wait_for(lambda: not visits.running(), "strategies are compared", JOB_S)
    yield from clicks.screenshot(OUT / "window.png")


def panels():
    """Each panel of the tab with its sub-panels, without the others."""
    found = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("PATCHNET_PT_")]
    ours = [
        each for each in found if getattr(each, "bl_category", "") == "PatchNet" and each.bl_space_type == "VIEW_3D"
    ]
    parents = {each.__name__: getattr(each, "bl_parent_id", "") for each in ours}
    top = [each for each in ours if parents[each.__name__] in ("", "PATCHNET_PT_main")]
    parts = {item: [item, *(each for each in ours if parents[each.__name__] == item.__name__)] for item in top}
    main = next(item for item in top if item.__name__ == "PATCHNET_PT_main")
    parts[main] = [main]
    for item in sorted(
        ours, key=lambda each: parents[each.__name__] in parents and parents[each.__name__] != main.__name__
    )[::-1]:
        bpy.utils.unregister_class(item)
    for item in top:
        for each in parts[item]:
            each.bl_options = set()
            each.bl_parent_id = "" if each is item else item.__name__
            bpy.utils.register_class(each)
        clicks.area("VIEW_3D").tag_redraw()
        yield 0.3
        clicks.region("UI").active_panel_category = "PatchNet"
        name = item.__name__.removeprefix("PATCHNET_PT_").replace("_", "-")
        yield from clicks.screenshot(OUT / f"panel-{name}.png", box(clicks.region("UI")))
        for each in reversed(parts[item]):
            bpy.utils.unregister_class(each)
    for item in (main, *(each for each in top if each is not main), *(each for each in ours if each not in top)):
        item.bl_parent_id = parents[item.__name__]
        bpy.utils.register_class(item)
    yield 0.5


def overlay():
    """Heatmap and preview with a wipe, over the camera's view and in an Image Editor."""
    values = bpy.context.window_manager.patchnet_overlay
    values.show_viewport = True
    values.use_wipe, values.wipe, values.picture, values.other = True, 0.5, "HEATMAP", "REFINED"
    yield from clicks.screenshot(OUT / "overlay-view.png", box(clicks.area("VIEW_3D")))
    values.show_viewport = False


def heatmap():
    """The heatmap in an Image Editor."""
    name = next(item.name for item in bpy.data.images if item.name.lower().endswith("heatmap"))
    yield from image_editor(name, "image-editor")


def image_editor(image: str, name: str):
    """An image in an Image Editor that replaces the viewport."""
    area = clicks.area("VIEW_3D")
    area.type = "IMAGE_EDITOR"
    yield 0.3
    area.spaces.active.image = bpy.data.images[image]
    in_area("IMAGE_EDITOR", bpy.ops.image.view_all, fit_view=True)
    yield from clicks.screenshot(OUT / f"{name}.png", box(clicks.area("IMAGE_EDITOR")))
    area.type = "VIEW_3D"
    yield 0.3


def engine():
    """A final render, and the viewport in the engine's shading mode."""
    scene = clicks.window().scene
    scene.render.engine = "PATCHNET"
    clicks.area("VIEW_3D").spaces.active.shading.type = "RENDERED"  # starts the world's map
    session = visits.module("session.scene_session").session_of(scene)
    yield from clicks.wait_for(lambda: session.world is not None, "the world's map", JOB_S)
    clicks.area("VIEW_3D").spaces.active.shading.type = "SOLID"
    bpy.context.preferences.view.render_display_type = "NONE"
    ended = visits.ends_of_renders()
    in_area("VIEW_3D", bpy.ops.render.render, "INVOKE_DEFAULT")
    yield from clicks.wait_for(lambda: bool(ended) and not bpy.app.is_job_running("RENDER"), "it is rendered", JOB_S)
    yield from image_editor("Render Result", "render-result")
    clicks.area("VIEW_3D").spaces.active.shading.type = "RENDERED"
    yield 45.0
    yield from clicks.screenshot(OUT / "viewport-rendered.png", box(clicks.region("WINDOW")))
    clicks.area("VIEW_3D").spaces.active.shading.type = "SOLID"


def preferences():
    """The add-on's preferences in their own window."""
    values = visits.preferences()
    values.open_pictures = values.bl_rna.properties["open_pictures"].default
    bpy.context.window_manager.addon_search = "PatchNet"
    bpy.ops.preferences.addon_expand(module=visits.PACKAGE)
    bpy.ops.screen.userpref_show(section="ADDONS")
    yield 2.0
    yield from clicks.screenshot(OUT / "preferences.png")


PARTS = (preview, overlay, heatmap, engine, panels, preferences)


def session():
    """Run all parts, or those of the command line."""
    yield from open_scene()
    names = sys.argv[sys.argv.index("--") + 2 :]
    for part in PARTS:
        if not names or part.__name__ in names:
            yield from part()


def finish(problem: str) -> None:
    """Write the error and quit."""
    (OUT / "screens.txt").write_text(problem)
    bpy.ops.wm.quit_blender()


bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.ui_scale = 1.0
bpy.context.preferences.system.use_region_overlap = False  # so that the sidebar does not cover the view
clicks.play(session(), finish)
