# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of the extension: its size, and its release to the system."""

from __future__ import annotations

import gc
from typing import NamedTuple

import bpy

from ...patchnet_addon.runtime.heap import resident_bytes, trim
from ..scene_access.own import is_own
from .scene_session import SceneSession, open_sessions


class Held(NamedTuple):
    """Bytes that the extension holds.

    results: octrees, codes and views of all scenes and rendered frames. images: pictures in the file. process: all of
    Blender with the extension; None if the system does not tell.
    """

    results: int
    images: int
    process: int | None


def give_back() -> None:
    """Collect garbage, and return free memory to the system, which allocators otherwise keep."""
    gc.collect()
    trim()


def held() -> Held:
    """Measure what the extension holds now."""
    images = sum(_image_bytes(image) for image in bpy.data.images if is_own(image))
    return Held(sum(map(_session_bytes, open_sessions())), images, resident_bytes())


def _session_bytes(session: SceneSession) -> int:
    """Bytes of octrees, codes and views of a scene."""
    frames = [frame.result for frame in (session.kept_frame, session.made_frame) if frame is not None]
    results = [result for result in (session.result, *frames) if result is not None]  # may share an octree
    octrees = {id(result.octree): result.octree.nbytes for result in results}
    codes = {id(result.coded): result.coded.nbytes for result in results if result.coded is not None}
    views = [array.nbytes for view in session.views.values() for array in (*view.values.values(), *view.looks.values())]
    return sum(octrees.values()) + sum(codes.values()) + sum(views)


def _image_bytes(image: bpy.types.Image) -> int:
    if not image.has_data:  # reading its size would load its pixels
        return 0
    width, height = image.size
    return width * height * image.channels * (4 if image.is_float else 1)
