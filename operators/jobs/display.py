# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a job in the status bar, beside the mouse pointer, in the panel and in the log."""

from __future__ import annotations

import bpy

from ...patchnet_addon.runtime.progress import Progress
from ...patchnet_addon.runtime.progress_log import ProgressLog
from ...patchnet_addon.runtime.remaining import Remaining


class JobDisplay:
    """Display of a job. progress: its latest report. whole: share of all that is done, as far as it was ever known.

    There is one share, which never falls; a step's own would, when the next one begins.
    """

    def __init__(self, title: str) -> None:
        self.progress = Progress(0, 1, title)
        self.whole: float | None = None
        self._text, self._at_pointer = "", False  # what the status bar shows, and whether the pointer has a number
        self._log = ProgressLog(title)
        self._remaining = Remaining()

    def see(self, progress: Progress) -> None:
        """Take a report of the job's steps."""
        self._log.see(progress)
        self._remaining.see(progress)
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
        remaining = "".join(f", {text}" for text in (self._remaining.text(), progress.note) if text)
        text = f"PatchNet: {progress.label}{share}{remaining}   (Esc stops)"
        if text != self._text:  # each new one draws the window again, which must not slow down what computes
            self._text = text
            if self.whole is not None:  # the pointer shows a number from its first report on
                if not self._at_pointer:
                    context.window_manager.progress_begin(0, 100)
                self._at_pointer = True
                context.window_manager.progress_update(round(100 * self.whole))
            context.workspace.status_text_set(text)
            _redraw(context, "UI")

    def end(self, context: bpy.types.Context) -> None:
        """Show nothing any more."""
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        _redraw(context)


def _redraw(context: bpy.types.Context, *kinds: str) -> None:
    """Draw the regions of some kinds again, such as the sidebars ("UI"); without kinds, all."""
    for area in context.screen.areas if context.screen else ():
        for region in area.regions:
            if not kinds or region.type in kinds:
                region.tag_redraw()
