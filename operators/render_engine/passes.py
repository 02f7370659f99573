# SPDX-License-Identifier: GPL-3.0-or-later
"""Render passes by name; `patchnet_addon/sampling/passes.py` computes their pixels.

| pass | channels | what it is |
|---|---|---|
| Combined | RGBA | scene-linear light as in Cycles, premultiplied by alpha, over the world unless film is transparent |
| Depth | Z | distance along the camera's axis, as in Cycles; 1e10 where nothing was hit |
| Normal | XYZ | mean normal of the voxel in world space, towards the camera, unit length; 0 where there is none |
| Priority | X | order in which pixels are refined: the strategy's score times painted importance |
| Coverage | X | covered share of the pixel as predicted by the network; 1 without look-ahead, 0 beside objects |
| Sample Count | X | rays traced for the pixel's colour: 1, or 1024 where refined; 1 to 1024 with samples per pixel |
| Level | X | octree level of the pixel's voxel; -1 where nothing was hit |
"""

from __future__ import annotations

from typing import NamedTuple

BY_PRIORITY = ("Priority", "Coverage")  # only if pixels are refined by priority


class Pass(NamedTuple):
    """Pass as registered in Blender: its name, a letter per channel, and the type of its socket."""

    name: str
    channels: str
    kind: str


PASSES = (
    Pass("Combined", "RGBA", "COLOR"),
    Pass("Depth", "Z", "VALUE"),
    Pass("Normal", "XYZ", "VECTOR"),
    Pass("Priority", "X", "VALUE"),
    Pass("Coverage", "X", "VALUE"),
    Pass("Sample Count", "X", "VALUE"),
    Pass("Level", "X", "VALUE"),
)
