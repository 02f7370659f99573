# SPDX-License-Identifier: GPL-3.0-or-later
"""Time of an animation that the engine renders: Blender calls it frame by frame, and says nothing of the others."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ...patchnet_addon.runtime.frames_time import FramesTime

_begun: dict[int, tuple[int, FramesTime]] = {}  # by scene: the frame that comes next, and the time of all


@contextmanager
def rendered_frame(engine: bpy.types.RenderEngine, scene: bpy.types.Scene) -> Iterator[FramesTime | None]:
    """Time of the animation that the frame rendered in the block belongs to; None for one that is rendered alone.

    A frame that is not the next of the last one begins another animation.
    """
    if not engine.is_animation:
        yield None
        return
    original = scene.original
    key, frame = original.session_uid, original.frame_current
    expected, frames = _begun.pop(key, (None, None))
    if frames is None or expected != frame:
        frames = FramesTime(len(range(frame, original.frame_end + 1, original.frame_step)) or 1)
    frames.begin()
    yield frames
    frames.end()
    _begun.clear()  # of other scenes, which may be gone
    _begun[key] = frame + original.frame_step, frames
