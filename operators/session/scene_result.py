# SPDX-License-Identifier: GPL-3.0-or-later
"""Result of a scene: octree, light, codes, figures of views, and its stale steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..state.block_hashes import GLOSS_MOVED

if TYPE_CHECKING:
    from ...patchnet_addon.codes.coded_octree import CodedOctree
    from ...patchnet_addon.octree.leaf_levels import LeafLevels
    from ...patchnet_addon.octree.octree import Octree
    from ..state.scene_state import Change, SceneState

VIEW = "view"
VOXELS = "voxels"  # in `made_by`: all that they depend on
_MAX_NAMES = 3  # reasons for a stale step, in one line


@dataclass(frozen=True)
class Row:
    """Error of a strategy in a comparison: mean squared over active pixels, after the budget."""

    name: str
    title: str
    error: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of all strategies on one view, best first.

    view: camera and size in words. unrefined: error of unrefined pixels without a budget. pictures: titles and errors
    of the pictures that unrefined pixels can show.
    """

    view: str
    budget: float
    unrefined: float
    rows: tuple[Row, ...]
    pictures: tuple[tuple[str, float], ...] = ()


@dataclass
class SceneResult:
    """Result of the steps that are done for a scene; codes are None until they are computed.

    scope: which objects were voxelized, "SELECTED" or "VISIBLE".
    layout: levels of the leaves, None where all are on the deepest.
    light: "none" while the octree shows the surface's own colour, else the kind of its light.
    unfinished: whether further rounds of the bake would refine the light.
    pictures: whether the result's pictures stand among Blender's images.
    comparison: strategies on a view, None without one. seconds: by stage. encoder: name of the codes' encoder. reasons:
    later changes, in words, by step: "surface", "light", and "view" for the pictures. made_with: the scene's settings
    at each step, by step. made_by: keys of the job's settings by step, "cameras" of those that the depth was chosen
    for, "track" of a track's, "seen" of those that the light was baked for, and "voxels", the `voxels_key`. state: of
    the scene when it was read, None if it is unknown.
    notes: sentences about omissions and approximations, by subject: "objects", "octree", "codes", "view", "cycles".
    summary: lines for the panel, written when a step ends, so that drawing computes nothing. frame_key: of settings and
    evaluated surface and light, "" until a rendered frame needs it.
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
    reasons: dict[str, list[str]] = field(default_factory=dict)
    made_with: dict[str, dict[str, Any]] = field(default_factory=dict)
    made_by: dict[str, str] = field(default_factory=dict)
    state: SceneState | None = None
    notes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    summary: list[str] = field(default_factory=list)
    unfinished: bool = False
    frame_key: str = ""

    @property
    def stale(self) -> set[str]:
        """Stale steps of "surface" and "light"; no step depends on pictures."""
        return set(self.reasons) - {VIEW}

    def see(self, change: Change) -> None:
        """Mark the steps that a change makes stale."""
        for step in change.steps:
            self.mark(step, change.text)

    def mark(self, step: str, why: str) -> None:
        """Mark a step, or the "view", as stale."""
        reasons = self.reasons.setdefault(step, [])
        if why not in reasons:
            reasons.append(why)

    def unmark(self, step: str) -> None:
        """Mark a step as current."""
        self.reasons.pop(step, None)

    def why(self, step: str) -> str:
        """Reason why a step is stale, in a few words."""
        names = self.reasons.get(step, [])
        return ", ".join(names[:_MAX_NAMES]) + (" and more" if len(names) > _MAX_NAMES else "")

    @property
    def all_notes(self) -> list[str]:
        """Notes of all steps, those of the picture first."""
        return list(dict.fromkeys(text for step in sorted(self.notes, reverse=True) for text in self.notes[step]))

    @property
    def is_stale_by_gloss_alone(self) -> bool:
        """Return whether only the camera moved that gloss was baked for."""
        return self.stale == {"light"} and self.reasons["light"] == [GLOSS_MOVED]
