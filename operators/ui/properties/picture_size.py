# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides of the pictures, each a number in pixels as in Blender's Format panel; both are kept as one setting, `size`."""

from __future__ import annotations

from typing import Any

import bpy

from ....patchnet_addon.runtime.bounds import SIZE_PX
from ...schema.table import TABLE
from .shapes import number


def _side(name: str, index: int) -> Any:
    """Property for a side: it reads and writes its number of `size`, and keeps nothing itself."""

    def read(values: bpy.types.PropertyGroup) -> int:
        return int(values.size[index])

    def write(values: bpy.types.PropertyGroup, side: int) -> None:
        values.size[index] = side

    text = "Pixels of the pictures; 0 follows the other side by the render aspect, twice 0 is the render resolution"
    return number(name, text, TABLE["size"].default[index], SIZE_PX, subtype="PIXEL", get=read, set=write)


class PictureSizeProperties:
    """Picture size, side by side."""

    size_x: _side("Picture Size X", 0)
    size_y: _side("Picture Size Y", 1)
