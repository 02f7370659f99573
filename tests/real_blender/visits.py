# SPDX-License-Identifier: GPL-3.0-or-later
"""Scripts in a Blender window: modules of the installed extension, reports, ends."""

import json
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType

import bpy
import clicks

PACKAGE = "bl_ext.user_default.patchnet"
OUT = Path(sys.argv[sys.argv.index("--") + 1])
_START = time.monotonic()


def module(name: str) -> ModuleType:
    """A module of the installed extension's `operators`."""
    return import_module(f"{PACKAGE}.operators.{name}")


def engine(name: str) -> ModuleType:
    """A module of the installed extension's `patchnet_addon`."""
    return import_module(f"{PACKAGE}.patchnet_addon.{name}")


def running() -> str:
    """Title of the job that works now, or ""."""
    return module("jobs.job_operator").job_in_window().title


def result():
    """Result of the scene so far, or None."""
    return module("session.results").result_of(clicks.window().scene)


def preferences() -> bpy.types.AddonPreferences:
    """Preferences of the extension."""
    return bpy.context.preferences.addons[PACKAGE].preferences


def choose(**values: object) -> None:
    """Settings of the scene."""
    for name, value in values.items():
        setattr(clicks.window().scene.patchnet, name, value)


def press(name: str) -> None:
    """Call an operator of ours as its button does."""
    in_area("VIEW_3D", getattr(bpy.ops.patchnet, name), "INVOKE_DEFAULT")


def in_area(kind: str, operator: Callable[..., object], *arguments: object, **settings: object) -> object:
    """Call an operator in the largest area of a kind."""
    pane = clicks.region("WINDOW", kind)
    with bpy.context.temp_override(window=clicks.window(), area=clicks.area(kind), region=pane):
        return operator(*arguments, **settings)


def made(*steps: str) -> None:
    """Call operators of ours, each to its end."""
    for step in steps:
        getattr(bpy.ops.patchnet, step)()


def baking(samples: int) -> clicks.Session:
    """Press Preview Selection, and wait until Cycles bakes; each place whose light is noisy gets up to `samples`."""
    choose(max_samples=samples, noise_threshold=0.0001)
    press("run_all")
    yield from clicks.wait_for(lambda: bpy.app.is_job_running("OBJECT_BAKE"), "Cycles bakes beside the window", 240.0)


def modal() -> list[str]:
    """Modal operators of all windows."""
    return [item.bl_idname for window in bpy.context.window_manager.windows for item in window.modal_operators]


def ends_of_renders() -> list[str]:
    """List that gets "complete" or "cancel" at the end of each render from now on."""
    ended: list[str] = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append("complete"))
    bpy.app.handlers.render_cancel.append(lambda *_: ended.append("cancel"))
    return ended


def render(width: int, height: int, engine: str = "PATCHNET", **values: object) -> None:
    """Call what F12 calls."""
    settings = clicks.window().scene.render
    settings.engine, settings.resolution_percentage = engine, 100
    settings.resolution_x, settings.resolution_y = width, height
    with bpy.context.temp_override(window=clicks.window()):
        bpy.ops.render.render("INVOKE_DEFAULT", **values)


def side_box() -> tuple[int, int, int, int]:
    """The sidebar, as a box for screenshots."""
    side = clicks.region("UI")
    return side.x, side.y, side.width, side.height


def open_tab() -> clicks.Session:
    """The tab in the sidebar."""
    clicks.area("VIEW_3D").spaces.active.show_region_ui = True
    yield 0.5
    clicks.region("UI").active_panel_category = "PatchNet"
    yield 0.5


def tabs() -> list[type]:
    """The panels of the tab."""
    return [item for item in module("ui").CLASSES if hasattr(item, "bl_category")]


def open_panels(names: set[str] | None = None) -> None:
    """Panels of the tab, all or those of these names, are open when they are drawn first; others are unregistered."""
    for item in reversed(tabs()):
        bpy.utils.unregister_class(item)
    for item in [each for each in tabs() if names is None or each.__name__ in names]:
        item.bl_options = set()
        bpy.utils.register_class(item)


class Heard:
    """Sayings of jobs since this was made. begun: their titles; labels: of their steps; told: their reports' texts.

    Jobs are heard of, not looked at: those that take a moment are over before anybody looks.
    """

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.labels: list[str] = []
        self.told: list[str] = []
        display, operators = module("jobs.job_window").JobDisplay, module("jobs.job_operator")
        begin, see, tell = display.begin, display.see, operators.tell

        def heard_begin(shown, context):
            self.begun.append(shown.progress.label)  # its title, before the first report
            begin(shown, context)

        def heard_see(shown, progress):
            if progress.label not in self.labels[-1:]:
                self.labels.append(progress.label)
            see(shown, progress)

        def heard_tell(operator, kind, text, **fields):
            self.told.append(text)
            tell(operator, kind, text, **fields)

        display.begin, display.see, operators.tell = heard_begin, heard_see, heard_tell


class Visit:
    """`seen` has a value for each thing that was seen; it goes into OUT/NAME.json. "clock": when parts were over."""

    def __init__(self, name: str) -> None:
        self.seen: dict[str, object] = {}
        self._path = OUT / f"{name}.json"
        self._clock: dict[str, float] = {}

    def save(self, part: str) -> None:
        """Write what was seen so far, after a part: also a Blender that crashes leaves it."""
        self._clock[part] = round(time.monotonic() - _START, 1)
        self._write(f"stopped after {part}")

    def parts(self, *parts: Callable[[], clicks.Session]) -> clicks.Session:
        """Parts one after the other, each saved by its name."""
        for part in parts:
            yield from part()
            self.save(part.__name__)

    def play(self, session: clicks.Session, *, pictures: str = "") -> None:
        """Run the session, then write what was seen and leave. pictures: where results come up, by the preferences."""
        view = bpy.context.preferences.view
        view.show_splash, view.ui_scale = False, 1.0
        if pictures:
            preferences().open_pictures = pictures
        clicks.play(session, self._finish)

    def _finish(self, problem: str) -> None:
        self._write(problem)
        bpy.ops.wm.quit_blender()

    def _write(self, problem: str) -> None:
        values = self.seen | {"clock": self._clock, "problem": problem}
        self._path.write_text(json.dumps(values, indent=1, default=str))


def watched(viewports: list) -> None:
    """Keep every viewport that draws, to ask it for its state."""
    kind = module("render_engine.viewport").Viewport
    before = kind.draw

    def draw(self, *given):
        before(self, *given)
        if self not in viewports:
            viewports.append(self)

    kind.draw = draw
