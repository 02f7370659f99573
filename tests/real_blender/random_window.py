# SPDX-License-Identifier: GPL-3.0-or-later
"""Somebody who clicks at random: panel, viewport, undo, files, windows, renders, the extension off and on again.

    blender --enable-event-simulate -p 0 0 1500 800 yard.blend -P random_window.py -- OUT [STEPS [SEED]]

Writes OUT/random.json, and each step into OUT/random-steps.txt before it is taken, so that a crash leaves the last.
"""

import faulthandler
import random
import sys
import time
from contextlib import suppress
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, PACKAGE, Visit, choose

WORDS = sys.argv[sys.argv.index("--") + 2 :]
STEPS, SEED = int(WORDS[0]) if WORDS else 100, int(WORDS[1]) if len(WORDS) > 1 else 0
YARD = bpy.data.filepath
SMALL = {"resolution": "DEPTH", "depth": 5, "samples": 1, "texel_voxels": 8.0, "size": (32, 24), "scope": "VISIBLE"}
CHOICES = {
    "light": ("cycles", "two-lights"), "resolution": ("AUTO", "FIT", "DEPTH"), "scope": ("SELECTED", "VISIBLE"),
    "size": ((0, 0), (24, 0), (16, 24)), "budget": (0.0, 0.3, 1.0), "unrefined": ("preview", "predicted"),
    "cameras": ("", "all", "auto", "Nobody"), "gloss": ("auto", "off", "camera"), "importance": ("NONE", "IMAGE"),
    "strategy": ("patchnet", "optimal", "random"), "reference": (False, True),
}  # fmt: skip
KEYS = ("G", "R", "S", "X", "H", "A", "TAB", "N", "Z", "DEL", "NUMPAD_0", "NUMPAD_5", "HOME", "SPACE", "RET")
EDITORS = ("IMAGE_EDITOR", "NODE_EDITOR", "PROPERTIES", "OUTLINER", "VIEW_3D")
WINDOW_WORK_S = 1.0
BEGUN = time.monotonic()

visit = Visit("random")
chance = random.Random(SEED)
steps = (OUT / "random-steps.txt").open("w")
faulthandler.enable(steps)  # what Python was at, where Blender crashes


def say(*words: object) -> None:
    """Write what is about to be done."""
    print(*words, file=steps, flush=True)


def inside(pane) -> tuple[int, int]:
    """Any point of a region or area."""
    return chance.randrange(pane.x, pane.x + max(pane.width, 1)), chance.randrange(pane.y, pane.y + max(pane.height, 1))


def windows() -> list[bpy.types.Window]:
    """All windows that are open."""
    return list(bpy.context.window_manager.windows)


def called(operator, *words: object, **values: object) -> None:
    """Call an operator over the 3D viewport, if there is one and the operator can be called there."""
    view = next((area for area in clicks.window().screen.areas if area.type == "VIEW_3D"), None)
    region = next((item for item in view.regions if item.type == "WINDOW"), None) if view else None
    with (
        suppress(RuntimeError),  # a report of an error, which is a sentence
        bpy.context.temp_override(window=clicks.window(), **({"area": view, "region": region} if view else {})),
    ):
        if operator.poll():
            say("", operator.idname_py(), *words, *values.values())
            operator(*words, **values)


def panel_click() -> clicks.Session:
    """A click somewhere in the sidebar, whatever is there."""
    yield from clicks.click(inside(clicks.region("UI")))


def panel_scroll() -> clicks.Session:
    """The wheel over the sidebar."""
    yield from clicks.scroll("UI", chance.choice(("WHEELDOWNMOUSE", "WHEELUPMOUSE")), 5)


def viewport_click() -> clicks.Session:
    """A click in the viewport."""
    x, y = inside(clicks.region("WINDOW"))
    yield from clicks.move(x, y)
    yield from clicks.key(chance.choice(("LEFTMOUSE", "RIGHTMOUSE", "MIDDLEMOUSE")), x, y)


def viewport_key() -> clicks.Session:
    """A key over the viewport, the mouse moves, and what began is confirmed or not."""
    x, y = inside(clicks.region("WINDOW"))
    yield from clicks.move(x, y)
    yield from clicks.key(chance.choice(KEYS), x, y)
    yield from clicks.move(*inside(clicks.region("WINDOW")))
    yield from clicks.key(chance.choice(("LEFTMOUSE", "ESC")), x, y)


def undo() -> clicks.Session:
    """Undo or redo, by key or by script."""
    x, y = clicks.over_viewport()
    if chance.random() < 0.5:
        yield from clicks.key("Z", x, y, ctrl=True)
    else:
        called(chance.choice((bpy.ops.ed.undo, bpy.ops.ed.redo)))


def escape() -> clicks.Session:
    """Esc over every window."""
    for window in windows():
        window.event_simulate(type="ESC", value="PRESS", x=300, y=300)
        window.event_simulate(type="ESC", value="RELEASE", x=300, y=300)
    yield 0.1


def job() -> clicks.Session:
    """A button of ours, wherever it stands."""
    shown = [name for name in dir(bpy.types) if name.startswith("PATCHNET_OT_")]
    shown = [name for name in shown if "INTERNAL" not in getattr(bpy.types, name).bl_options]
    names = [name.removeprefix("PATCHNET_OT_") for name in shown]
    called(getattr(bpy.ops.patchnet, chance.choice(names)), "INVOKE_DEFAULT")
    yield chance.random() * WINDOW_WORK_S


def setting() -> clicks.Session:
    """Another value of a setting."""
    name = chance.choice(list(CHOICES))
    value = chance.choice(CHOICES[name])
    say("", name, value)
    setattr(clicks.window().scene.patchnet, name, value)
    yield 0.0


def file() -> clicks.Session:
    """Save, open, revert, or begin anew."""
    path = str(OUT / "random.blend")
    chance.choice(
        (
            lambda: called(bpy.ops.wm.save_as_mainfile, filepath=path, copy=True),
            lambda: called(bpy.ops.wm.open_mainfile, filepath=YARD),
            lambda: called(bpy.ops.wm.read_homefile),
            lambda: called(bpy.ops.wm.revert_mainfile),
        )
    )()
    yield 0.3
    small()


def window() -> clicks.Session:
    """A window comes or goes, or an editor becomes another one."""
    if chance.random() < 0.3 and len(windows()) < 4:
        called(bpy.ops.wm.window_new)
    elif chance.random() < 0.5 and len(windows()) > 1:
        say("", "close a window")
        with bpy.context.temp_override(window=windows()[-1]):
            bpy.ops.wm.window_close()
    else:
        areas = [area for area in clicks.window().screen.areas if area != clicks.area("VIEW_3D")]
        one, kind = chance.choice(areas), chance.choice(EDITORS)
        say("", one.type, "becomes", kind)
        one.type = kind
    yield 0.3


def scene() -> clicks.Session:
    """Another scene, or one less."""
    called(bpy.ops.scene.new if chance.random() < 0.5 else bpy.ops.scene.delete)
    yield 0.2
    small()


def render() -> clicks.Session:
    """A render by any engine that is not slow here, or the viewport's."""
    engine = clicks.window().scene.render.engine = chance.choice(("PATCHNET", "CYCLES"))
    say("", engine)
    if chance.random() < 0.5:
        called(bpy.ops.render.render, "INVOKE_DEFAULT")
    else:
        clicks.area("VIEW_3D").spaces.active.shading.type = chance.choice(("RENDERED", "SOLID"))
    yield chance.random() * WINDOW_WORK_S


def work() -> clicks.Session:
    """Whatever runs goes on."""
    yield WINDOW_WORK_S


def extension() -> clicks.Session:
    """The extension goes, and comes back; not in the middle of typing into one of its fields, which Blender forgets."""
    yield from escape()
    called(bpy.ops.preferences.addon_disable, module=PACKAGE)
    yield 0.3
    called(bpy.ops.preferences.addon_enable, module=PACKAGE)
    yield 0.3
    small()


OFTEN = {
    panel_click: 8, panel_scroll: 2, viewport_click: 3, viewport_key: 6, undo: 4, escape: 4, job: 8, setting: 5,
    file: 1, window: 2, scene: 1, render: 2, work: 3, extension: 1,
}  # fmt: skip


def small() -> None:
    """Small pictures of coarse voxels, Blender's small renders, and the tab in front."""
    scene = clicks.window().scene
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 48, 32, 1
    choose(**SMALL)
    if not any(area.type == "VIEW_3D" for area in clicks.window().screen.areas):
        max(clicks.window().screen.areas, key=lambda area: area.width * area.height).type = "VIEW_3D"
    clicks.area("VIEW_3D").spaces.active.show_region_ui = True
    with suppress(AttributeError, TypeError):  # a sidebar that was not drawn yet has no tabs
        clicks.region("UI").active_panel_category = "PatchNet"


def session() -> clicks.Session:
    """So many steps."""
    small()
    yield 0.5
    for number in range(STEPS):
        action = chance.choices(list(OFTEN), list(OFTEN.values()))[0]
        say(number, action.__name__, f"{time.monotonic() - BEGUN:.1f} s")
        if any(area.type == "VIEW_3D" for area in clicks.window().screen.areas):
            yield from action()
        else:  # a click made it another editor
            small()
            yield 0.3
        visit.seen["steps"] = number + 1


visit.play(session())
