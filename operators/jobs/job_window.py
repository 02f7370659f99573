# SPDX-License-Identifier: GPL-3.0-or-later
"""Window of a running job: progress in status bar, panel and log, and the events that Blender may handle.

Menus, saving and navigation work, editing does not. Menus and scripts can still edit the scene, which `state/watch.py`
notices.
"""

from __future__ import annotations

import bpy

from ...patchnet_addon.runtime.eta import Eta
from ...patchnet_addon.runtime.progress import Progress
from ...patchnet_addon.runtime.progress_log import ProgressLog

_MOUSE = frozenset({"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "WINDOW_DEACTIVATE"})
# Editors without the scene.
_HARMLESS_EDITORS = frozenset({"FILE_BROWSER", "IMAGE_EDITOR", "INFO", "PREFERENCES", "STATUSBAR", "TOPBAR"})
# Keymaps that are searched, and operators in them that do not change the scene.
_KEYMAPS = ("Window", "Screen", "3D View", "3D View Generic", "View2D", "Image", "Image Generic")
_HARMLESS_OPERATORS = frozenset(
    {
        "wm.save_mainfile", "wm.save_as_mainfile", "wm.quit_blender", "wm.call_menu", "wm.search_menu",
        "wm.context_toggle", "wm.window_fullscreen_toggle", "screen.screen_full_area", "screen.space_context_cycle",
        "screen.workspace_cycle", "screen.screenshot", "screen.userpref_show", "render.view_show",
    }
)  # fmt: skip
_LOOKING = (
    "view3d.view_", "view3d.zoom", "view3d.rotate", "view3d.move", "view3d.dolly", "view3d.localview",
    "view3d.toggle_shading", "view3d.ndof", "view2d.", "image.view_",
)  # fmt: skip


class JobDisplay:
    """Display of a job, by its title. progress: latest report. whole: share of the job that is done, None if unknown.

    The share never falls.
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self.progress = Progress(0, 1, title)
        self.whole: float | None = None
        self._text = ""  # of the status bar
        self._log = ProgressLog(title)
        self._eta = Eta()

    def see(self, progress: Progress) -> None:
        """Take a report of the job's steps."""
        self._log.see(progress)
        self._eta.see(progress)
        self.progress = progress
        if progress.whole is not None:
            self.whole = max(self.whole or 0.0, progress.whole)

    def begin(self, context: bpy.types.Context) -> None:
        """Begin a job in this window."""
        _redraw(context, "UI")

    def show(self, context: bpy.types.Context) -> None:
        """Show the latest report."""
        progress = self.progress
        share = progress.count_text if self.whole is None else f" {round(100 * self.whole)} %"
        remaining = "".join(f", {text}" for text in (self._eta.text(), progress.note) if text)
        text = f"PatchNet: {progress.label}{share}{remaining}   (Esc stops)"
        if text != self._text:  # redrawing the window slows down the job
            self._text = text
            context.workspace.status_text_set(text)
            _redraw(context, "UI")

    def end(self, context: bpy.types.Context) -> None:
        """Hide the progress."""
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        _redraw(context)


def _redraw(context: bpy.types.Context, *kinds: str) -> None:
    """Redraw regions of some kinds, such as sidebars ("UI"); without kinds, all."""
    for area in context.screen.areas if context.screen else ():
        for region in area.regions:
            if not kinds or region.type in kinds:
                region.tag_redraw()


def passes(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Return whether Blender may handle an event, because it does not change the scene of a job."""
    if event.type in _MOUSE:
        return True
    window = context.window
    return window is None or not _over_scene(window, event) or _leaves_scene_alone(context, event)


def _over_scene(window: bpy.types.Window, event: bpy.types.Event) -> bool:
    """Return whether the mouse is over the main region of an editor of the scene, not over menus or sidebars."""
    for area in window.screen.areas:
        if area.type not in _HARMLESS_EDITORS and inside(area, event):
            return not any(region.type != "WINDOW" and inside(region, event) for region in area.regions)
    return False


def inside(part: bpy.types.Area | bpy.types.Region, event: bpy.types.Event) -> bool:
    """Return whether the mouse is over a part of a window."""
    right, top = part.x + part.width, part.y + part.height
    return part.x <= event.mouse_x < right and part.y <= event.mouse_y < top


def _leaves_scene_alone(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Return whether all operators that the user's keymap has for an event leave the scene unchanged."""
    keymaps = context.window_manager.keyconfigs.user.keymaps
    found = (keymaps[name].keymap_items.match_event(event) for name in _KEYMAPS if name in keymaps)
    names = [item.idname for item in found if item is not None]
    return bool(names) and all(name in _HARMLESS_OPERATORS or name.startswith(_LOOKING) for name in names)
