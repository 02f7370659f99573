# SPDX-License-Identifier: GPL-3.0-or-later
"""Each panel of the tab alone, in a window with results, as a screenshot; undo and redo with keys; the preferences.

    blender --enable-event-simulate -p 0 0 1500 1100 courtyard.blend -P panels.py -- OUT

Writes OUT/panels.json and OUT/panel-NAME.png. test_panels.py judges them.
"""

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, PACKAGE, Visit, module, open_panels, side_box, tabs

SMALL = {
    "resolution": "DEPTH", "depth": 6, "light": "two-lights", "size": (48, 32), "cameras": "Far", "scope": "VISIBLE",
}  # fmt: skip
visit = Visit("panels")
seen = visit.seen
seen["drawn"] = []


def result():
    """Result of the scene, or None."""
    return module("session.results").result_of(clicks.window().scene)


def call(name: str, **values: object) -> None:
    """Run an operator to its end, as a script does."""
    with bpy.context.temp_override(window=clicks.window(), area=clicks.area("VIEW_3D")):
        getattr(bpy.ops.patchnet, name)("EXEC_DEFAULT", **values)


def prepare():
    """Settings, results, and the tab as wide as its longest line."""
    settings = clicks.window().scene.patchnet
    for name, value in SMALL.items():
        setattr(settings, name, value)
    open_panels()
    if not clicks.area("VIEW_3D").spaces.active.show_region_ui:
        yield from clicks.key("N", *clicks.over_viewport())
    yield 0.5
    clicks.region("UI").active_panel_category = "PatchNet"
    yield 0.5
    yield from clicks.screenshot(OUT / "panel-empty.png", side_box())
    call("estimate")
    call("run_all")
    settings.light, settings.importance = "cycles", "IMAGE"
    settings.importance_image = "Mask"
    yield 0.3


def one_by_one():
    """Every sub-panel with all its parts, the others away."""
    classes = tabs()
    for item in reversed(classes):
        bpy.utils.unregister_class(item)
    for item in [each for each in classes if getattr(each, "bl_parent_id", "") in ("", "PATCHNET_PT_main")]:
        name = item.__name__.removeprefix("PATCHNET_PT_")
        parts = [each for each in classes if each is item or each.__name__ == "PATCHNET_PT_main"]
        parts += [each for each in classes if getattr(each, "bl_parent_id", "") == item.__name__ != "PATCHNET_PT_main"]
        for each in parts:
            bpy.utils.register_class(each)
        clicks.area("VIEW_3D").tag_redraw()
        yield 0.3
        clicks.region("UI").active_panel_category = "PatchNet"
        yield from clicks.screenshot(OUT / f"panel-{name}.png", side_box())
        seen["drawn"] += [each.__name__ for each in parts]
        for each in reversed(parts):
            bpy.utils.unregister_class(each)
    for item in classes:
        bpy.utils.register_class(item)
    yield 0.5


def undo_and_redo():
    """A move makes the result stale, undo makes it fit again, and so on, with keys."""
    settings = clicks.window().scene.patchnet
    settings.light, settings.importance = "two-lights", "NONE"
    name = next(item.name for item in clicks.window().scene.objects if item.type == "MESH" and item.visible_get())
    x, y = clicks.over_viewport()
    for item in clicks.window().view_layer.objects:
        item.select_set(item.name == name)
    clicks.window().view_layer.objects.active = bpy.data.objects[name]
    bpy.ops.ed.undo_push(message="before")
    states = [sorted(result().stale)]
    yield from clicks.move(x, y)
    yield from clicks.key("G", x, y)
    yield from clicks.move(x + 40, y + 40)
    yield from clicks.key("LEFTMOUSE", x + 40, y + 40)
    while clicks.window().modal_operators:  # a move that has not ended yet is no step that undo could take back
        yield 0.1
    yield 0.3
    states.append(sorted(result().stale))
    seen["why"] = result().why("surface")
    yield from clicks.screenshot(OUT / "panel-stale.png", side_box())
    yield from clicks.key("Z", x, y, ctrl=True)
    yield 0.5
    states.append(sorted(result().stale))
    bpy.ops.ed.redo()
    yield 0.5
    states.append(sorted(result().stale))
    seen["states"] = states


def preferences():
    """The add-on's preferences in their own window."""
    call("measure_cache")
    bpy.context.window_manager.addon_search = "PatchNet"
    bpy.ops.preferences.addon_expand(module=PACKAGE)
    bpy.ops.screen.userpref_show(section="ADDONS")
    yield 1.0
    yield from clicks.screenshot(OUT / "panel-preferences.png")


def session():
    """The whole visit."""
    for part in (prepare, one_by_one, undo_and_redo, preferences):
        yield from part()


visit.play(session(), pictures="NEVER")  # a window would cover this one
