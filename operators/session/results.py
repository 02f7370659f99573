# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of scenes, which panels and operators read; `keep.py` keeps new ones, `staleness.py` compares them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import bpy

from ...patchnet_addon.export.fine_light import noise_text
from ...patchnet_addon.octree.exposure import exposure_text
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.quantities import counted, error_text
from ..scene_access.lengths import length_text
from ..scene_access.main_thread import in_main_thread
from .scene_result import SceneResult
from .scene_session import session_of

if TYPE_CHECKING:
    from ...patchnet_addon.codes.coded_octree import CodedOctree

_LIGHTS = {"none": "none, the surface's own color", "cycles": "Cycles", "two-lights": "Two Lights"}
_STEPS = {
    "read": "Reading", "depth": "Depth", "voxelize": "Voxels", "light": "Light",
    "codes": "Look-ahead", "views": "Views",
}  # fmt: skip
NO_VOXELS = "There are no voxels yet: run Voxelize first"
NO_CODES = "Look-ahead is not prepared yet: run Prepare Look-Ahead first"


def summary(result: SceneResult, scene: bpy.types.Scene) -> list[str]:
    """Lines for the panel: size, light, look-ahead, errors and times; lengths in the scene's units."""
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


def unfinished_text(result: SceneResult, *, running: bool = False) -> str:
    """Sentence about the noise of light that is not refined to the threshold, or ""; running: the job goes on."""
    if not result.unfinished or result.stale:
        return ""
    text = f"Light of noise {noise_text(result.octree)}"
    return f"{text} is being refined" if running else f"{text}: press Preview Selection again to refine it"


def result_of(scene: bpy.types.Scene) -> SceneResult | None:
    """Result of `scene`, or None."""
    return session_of(scene).result


def voxels_of(scene: bpy.types.Scene) -> SceneResult:
    """Result of `scene`; raises SettingError without one."""
    result = result_of(scene)
    if result is None:
        raise SettingError(NO_VOXELS)
    return result


def codes_of(scene: bpy.types.Scene) -> CodedOctree:
    """Codes of `scene`; raises SettingError without any."""
    coded = voxels_of(scene).coded
    if coded is None:
        raise SettingError(NO_CODES)
    return coded


def put(scene: bpy.types.Scene, result: SceneResult) -> None:
    """Replace the result of `scene`."""
    result.summary = summary(result, scene)
    session_of(scene).result = result
    redraw_viewports()


def without_view(result: SceneResult) -> SceneResult:
    """Copy a result without the figures of a view."""
    made = replace(result, lookahead_share=None, pictures=False, comparison=None, errors=None)
    made.notes = {step: texts for step, texts in result.notes.items() if step not in ("view", "cycles")}
    made.unmark("view")
    return made


def forget(scene: bpy.types.Scene) -> None:
    """Free the result, views and octrees of frames of `scene`."""
    session_of(scene).free()
    redraw_viewports()


def redraw_viewports() -> None:
    """Redraw viewports, as the engine's shading mode shows results; a render in a window leaves them alone."""
    if not in_main_thread():
        return
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
