# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of each scene, held in memory and dropped with the file; `staleness.py` sees if they still fit."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.handlers import persistent

from ...patchnet_addon.runtime.errors import SettingError
from ..state.watch import changes_meanwhile
from .summary import summary

if TYPE_CHECKING:
    from ...patchnet_addon.codes.coded_octree import CodedOctree
    from ...patchnet_addon.octree.leaf_levels import LeafLevels
    from ...patchnet_addon.octree.octree import Octree
    from ..pipeline.estimate import Estimate
    from ..state.scene_state import SceneState

NO_VOXELS = "There are no voxels yet: run Voxelize first"
NO_CODES = "There are no codes yet: run Precompute Codes first"
VIEW = "view"
_MOST_NAMES = 3  # of what made a step stale, in one line


@dataclass(frozen=True)
class Row:
    """Error of a strategy in a comparison: mean squared over active pixels, after the budget."""

    name: str
    title: str
    error: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of all strategies on one view, best first.

    view: camera and size, in words. unrefined: the error without a budget.
    """

    view: str
    budget: float
    unrefined: float
    rows: tuple[Row, ...]


@dataclass
class SceneResult:
    """Steps that are done for a scene; codes are None until they were computed.

    scope: which objects were voxelized, "SELECTED" or "VISIBLE".
    layout: levels of the leaves, None where all are on the deepest.
    light: "none" while the octree shows the surface's own colour, else the light that was baked.
    pictures: whether the result's pictures stand among Blender's images.
    comparison: strategies on a view, None before they were compared. seconds: by stage. encoder: of the codes.
    stale: the steps whose input changed since: "surface", "light". reasons: names of what changed, by step, and for
    the pictures, "view", which make nothing else stale.
    made_with: the scene's settings when each step was done, by step. state: of the scene when it was read for them,
    None where nothing was compared with it.
    summary: lines for the panel, written when a step ends, so that drawing computes nothing.
    """

    octree: Octree
    scope: str
    layout: LeafLevels | None = None
    light: str = "none"
    coded: CodedOctree | None = None
    lookahead_share: float | None = None
    pictures: bool = False
    comparison: Comparison | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    encoder: str = ""
    errors: tuple[float, float] | None = None
    stale: set[str] = field(default_factory=set)
    reasons: dict[str, list[str]] = field(default_factory=dict)
    made_with: dict[str, dict[str, Any]] = field(default_factory=dict)
    state: SceneState | None = None
    summary: list[str] = field(default_factory=list)

    def mark(self, step: str, what: str) -> None:
        """Mark a step, or the "view", as not fitting the scene any more, because of `what`; a few names are kept."""
        if step != VIEW:
            self.stale.add(step)
        names = self.reasons.setdefault(step, [])
        if what not in names and len(names) <= _MOST_NAMES:
            names.append(what)

    def known_changes(self) -> set[str]:
        """Names that are marked already, so that they are not looked at again."""
        return {what for names in self.reasons.values() for what in names}

    def unmark(self, step: str) -> None:
        """Unmark a step, which fits the scene again."""
        self.stale.discard(step)
        self.reasons.pop(step, None)

    def why(self, step: str) -> str:
        """Reason for a stale step, in a few words."""
        names = self.reasons.get(step, [])
        return ", ".join(names[:_MOST_NAMES]) + (" and more" if len(names) > _MOST_NAMES else "")

    @property
    def nbytes(self) -> int:
        """Bytes that the result holds."""
        return self.octree.nbytes + (self.coded.nbytes if self.coded else 0)


# Called with a scene and its result after a step that is worth keeping.
listeners: list[Callable[[bpy.types.Scene, SceneResult], None]] = []
_results: dict[int, SceneResult] = {}
_estimates: dict[int, Estimate] = {}


def result_of(scene: bpy.types.Scene) -> SceneResult | None:
    """Return the result of `scene`, None if there is none."""
    return _results.get(scene.session_uid)


def voxels_of(scene: bpy.types.Scene) -> SceneResult:
    """Result of `scene`; raises SettingError with what to do if there is none."""
    result = result_of(scene)
    if result is None:
        raise SettingError(NO_VOXELS)
    return result


def codes_of(scene: bpy.types.Scene) -> CodedOctree:
    """Codes of `scene`; raises SettingError with what to do if there are none."""
    coded = voxels_of(scene).coded
    if coded is None:
        raise SettingError(NO_CODES)
    return coded


def keep(scene: bpy.types.Scene, result: SceneResult, *steps: str) -> None:
    """Replace what is there for `scene`; `steps`: those that were done now, of "octree", "light", "codes", "view"."""
    from ..settings.step_settings import recorded

    result.made_with = result.made_with | {step: recorded(scene.patchnet, step) for step in steps}
    if {"octree", "light"} & set(steps):
        for step, what in changes_meanwhile():
            result.mark(step, what)
    result.octree.free_keys()
    result.summary = summary(result)
    _results[scene.session_uid] = result
    _redraw_viewports()
    if {"octree", "light", "codes"} & set(steps):
        for listener in listeners:
            listener(scene, result)


def without_view(result: SceneResult) -> SceneResult:
    """Copy a result without what was found out about a view."""
    made = replace(result, lookahead_share=None, pictures=False, comparison=None, errors=None)
    made.unmark("view")
    return made


def forget(scene: bpy.types.Scene) -> None:
    """Free the memory that results of `scene` take."""
    _results.pop(scene.session_uid, None)
    _redraw_viewports()


def in_main_thread() -> bool:
    """Return whether this is not the thread of a render beside a window."""
    return threading.current_thread() is threading.main_thread()


def _redraw_viewports() -> None:
    """Redraw viewports, as the engine's shading mode shows results; a render beside a window leaves them alone."""
    if not in_main_thread():
        return
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def estimate_of(scene: bpy.types.Scene) -> Estimate | None:
    """Return the last estimate for `scene`, None if there is none."""
    return _estimates.get(scene.session_uid)


def keep_estimate(scene: bpy.types.Scene, estimate: Estimate) -> None:
    """Replace the estimate for `scene`."""
    _estimates[scene.session_uid] = estimate


def all_results() -> list[SceneResult]:
    """Results of all scenes."""
    return list(_results.values())


def held_bytes() -> int:
    """Bytes that all results hold."""
    return sum(result.nbytes for result in _results.values())


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Note how long the block took."""
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = time.perf_counter() - start


@persistent
def _on_load(_path: str) -> None:
    _results.clear()
    _estimates.clear()


def register() -> None:
    """Drop results when another file is opened."""
    bpy.app.handlers.load_post.append(_on_load)


def unregister() -> None:
    """Free all results."""
    bpy.app.handlers.load_post.remove(_on_load)
    _on_load("")
