# SPDX-License-Identifier: GPL-3.0-or-later
"""Handover of a viewport's picture from one engine of Blender's to the next.

Whenever the engine of any scene is set, Blender ends the engines of all viewports and begins new ones. Looks at the
world set that of a scene of theirs for each of their parts, and a picture that begins anew each time would not end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..session.memory import give_back

if TYPE_CHECKING:
    from .viewport import Viewport

_KEPT_S = 1.0  # at least, and at most twice
_left: dict[int, Viewport] = {}  # by the address of the region that they were drawn in
_old: list[Viewport] = []  # those of them that were there when time was looked at


def leave(viewport: Viewport) -> None:
    """Keep what an engine that ends has drawn, for a moment."""
    _left[viewport.region] = viewport
    if not bpy.app.timers.is_registered(_free):
        bpy.app.timers.register(_free, first_interval=_KEPT_S, persistent=True)


def left_in(region: bpy.types.Region) -> Viewport | None:
    """What an engine has left of a region, if it ended just now."""
    viewport = _left.pop(region.as_pointer(), None)
    if viewport is not None:
        _old[:] = [each for each in _old if each is not viewport]
        viewport.adopted()
    return viewport


def _free() -> float | None:
    """Free what nobody took since the last time: there was time to draw between the two, however long work took."""
    gone = [region for region, viewport in _left.items() if viewport in _old]
    for region in gone:
        del _left[region]
    _old[:] = _left.values()
    if gone:
        give_back()  # steps of a preview that did not end hold it, and it them
    return _KEPT_S if _left else None


def unregister() -> None:
    """Free what is kept."""
    _left.clear()
    _old.clear()
    if bpy.app.timers.is_registered(_free):
        bpy.app.timers.unregister(_free)
