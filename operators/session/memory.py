# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of the extension in Blender: what it holds, and the release of what it needs no more to the system."""

from __future__ import annotations

import gc
from collections.abc import Iterable
from dataclasses import is_dataclass
from typing import Any, NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.runtime.heap import resident_bytes, trim
from ..scene_access.own import is_own
from .scene_session import open_sessions


class Held(NamedTuple):
    """Bytes that the extension holds.

    results: octrees, codes and views of all scenes, and those of frames that are rendered. images: pictures in the
    file. process: all that Blender takes, the extension included; None where the system does not say.
    """

    results: int
    images: int
    process: int | None


def give_back() -> None:
    """Collect what is not used, and return what is free to the system, which allocators else keep for themselves."""
    gc.collect()
    trim()


def held() -> Held:
    """Measure what the extension holds now."""
    images = sum(_image_bytes(image) for image in bpy.data.images if is_own(image))
    return Held(array_bytes(open_sessions()), images, resident_bytes())


def array_bytes(holders: Iterable[Any]) -> int:
    """Bytes of all NumPy arrays that are reached from some objects; what two of them share counts once."""
    found: dict[int, int] = {}
    seen: set[int] = set()
    waiting = list(holders)
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            while isinstance(item.base, np.ndarray):
                item = item.base
            found[id(item)] = item.nbytes
        elif isinstance(item, dict):
            waiting.extend(item.values())
        elif isinstance(item, (list, tuple)):
            waiting.extend(item)
        elif is_dataclass(item):
            waiting.extend(vars(item).values())
    return sum(found.values())


def _image_bytes(image: bpy.types.Image) -> int:
    if not image.has_data:  # asking such an image for its size would read its pixels
        return 0
    width, height = image.size
    return width * height * image.channels * (4 if image.is_float else 1)
