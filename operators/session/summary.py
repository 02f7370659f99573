# SPDX-License-Identifier: GPL-3.0-or-later
"""Summary of a scene's result, in a few lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ...patchnet_addon.octree.exposure import exposure_text
from ...patchnet_addon.runtime.quantities import counted, error_text
from ..scene_access.lengths import length_text

if TYPE_CHECKING:
    from .scene_result import SceneResult

_LIGHTS = {"none": "none, the surface's own color", "cycles": "Cycles", "two-lights": "Two Lights"}
_STEPS = {
    "read": "Reading",
    "depth": "Depth",
    "voxelize": "Voxels",
    "light": "Light",
    "denoise": "Denoising",
    "codes": "Look-ahead",
    "views": "Views",
}


def summary(result: SceneResult, scene: bpy.types.Scene) -> list[str]:
    """Lines for the panel: size, light, look-ahead, errors, and where the time went; lengths in the scene's units."""
    octree = result.octree
    side = length_text(scene, octree.grid.voxel_size_world)
    lines = [
        f"Depth {'up to ' if result.layout else ''}{octree.depth}, voxel side {side}",
        f"{counted(octree.leaf_count, 'voxel')}, {counted(octree.node_count, 'node')}",
        f"Light: {_LIGHTS.get(result.light, result.light)}",
        *([exposure_text(octree)] if "exposure" in octree.provenance else []),
    ]
    if result.coded is not None:
        lines.append(f"{counted(result.coded.coded_count, 'voxel')} with look-ahead")
        lines += [f"Prepared by {result.encoder}"] if result.encoder else []
    if result.lookahead_share is not None:
        lines.append(f"Look-ahead on {result.lookahead_share:.1%} of pixels")
    if result.errors is not None:
        lines.append("Error x 10,000: {}, refined {}".format(*map(error_text, result.errors)))
    spent = [f"{_STEPS[name]} {value:.1f} s" for name, value in result.seconds.items() if name in _STEPS]
    return lines + [", ".join(spent[start : start + 2]) for start in range(0, len(spent), 2)]
