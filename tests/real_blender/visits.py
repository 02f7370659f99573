# SPDX-License-Identifier: GPL-3.0-or-later
"""What all visits to a Blender window share: the installed extension, where they write what they saw, how they end."""

import json
import sys
import time
from pathlib import Path
from types import ModuleType

import bpy
import clicks

PACKAGE = "bl_ext.user_default.patchnet"
OUT = Path(sys.argv[sys.argv.index("--") + 1])
_START = time.monotonic()


def module(name: str) -> ModuleType:
    """A module of the installed extension's `operators`, once it is imported."""
    return sys.modules[f"{PACKAGE}.operators.{name}"]


def side_box() -> tuple[int, int, int, int]:
    """The sidebar, as a box for screenshots."""
    side = clicks.region("UI")
    return side.x, side.y, side.width, side.height


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

    def play(self, session: clicks.Session, *, pictures: str = "") -> None:
        """Run the session, then write what was seen and leave. pictures: where results come up, by the preferences."""
        preferences = bpy.context.preferences
        preferences.view.show_splash = False
        preferences.view.ui_scale = 1.0
        if pictures:
            preferences.addons[PACKAGE].preferences.open_pictures = pictures
        clicks.play(session, self._finish)

    def _finish(self, problem: str) -> None:
        self._write(problem)
        bpy.ops.wm.quit_blender()

    def _write(self, problem: str) -> None:
        values = self.seen | {"clock": self._clock, "problem": problem}
        self._path.write_text(json.dumps(values, indent=1, default=str))
