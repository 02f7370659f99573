# SPDX-License-Identifier: GPL-3.0-or-later
"""Result of a scene: its octree, light and codes, what was measured on views, and what of it is stale."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..state.block_hashes import GLOSS_MOVED

if TYPE_CHECKING:
    from ...patchnet_addon.codes.coded_octree import CodedOctree
    from ...patchnet_addon.octree.leaf_levels import LeafLevels
    from ...patchnet_addon.octree.octree import Octree
    from ..state.scene_state import Change, SceneState

VIEW = "view"
_MAX_NAMES = 3  # of what made a step stale, in one line


@dataclass(frozen=True)
class Row:
    """Error of a strategy in a comparison: mean squared over active pixels, after the budget."""

    name: str
    title: str
    error: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of all strategies on one view, best first.

    view: camera and size, in words. unrefined: the error without a budget, of what unrefined pixels show. pictures:
    titles and errors of all pictures that they may show.
    """

    view: str
    budget: float
    unrefined: float
    rows: tuple[Row, ...]
    pictures: tuple[tuple[str, float], ...] = ()


@dataclass
class SceneResult:
    """Result of the steps that are done for a scene; codes are None until they were computed.

    scope: which objects were voxelized, "SELECTED" or "VISIBLE".
    layout: levels of the leaves, None where all are on the deepest.
    light: "none" while the octree shows the surface's own colour, else the light that was baked.
    pictures: whether the result's pictures stand among Blender's images.
    comparison: strategies on a view, None before they were compared. seconds: by stage. encoder: who made the codes.
    reasons: what changed since, in words, by step ("surface", "light", and "view" for the pictures) and by what it is.
    made_with: the scene's settings when each step was done, by step; made_by: keys of the job's, and of the cameras
    that the depth was found for. state: of the scene when it was read for them,
    None where nothing was compared with it.
    notes: sentences on what was left out or is approximate, by what they are of: "objects", "octree", "codes", "view",
    "cycles".
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
    reasons: dict[str, dict[Hashable, str]] = field(default_factory=dict)
    made_with: dict[str, dict[str, Any]] = field(default_factory=dict)
    made_by: dict[str, str] = field(default_factory=dict)
    state: SceneState | None = None
    notes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    summary: list[str] = field(default_factory=list)

    @property
    def stale(self) -> set[str]:
        """Steps whose input changed since: "surface", "light"; pictures make nothing else stale."""
        return set(self.reasons) - {VIEW}

    def see(self, change: Change) -> None:
        """Mark what a change does not fit any more, and unmark what it was marked for and fits again."""
        for step in set(self.reasons) - set(change.steps):
            self.reasons[step].pop(change.key, None)
            if not self.reasons[step]:
                self.unmark(step)
        for step in change.steps:
            if step != VIEW or self.lookahead_share is not None:
                self.mark(step, change.text, change.key)

    def mark(self, step: str, what: str, key: Hashable = None) -> None:
        """Mark a step, or the "view", as stale because of `what`; key: what it is, by default its words."""
        self.reasons.setdefault(step, {})[what if key is None else key] = what

    def known_changes(self) -> set[Hashable]:
        """Keys of what is marked."""
        return {key for marks in self.reasons.values() for key in marks}

    def unmark(self, step: str) -> None:
        """Take back that a step is stale."""
        self.reasons.pop(step, None)

    def why(self, step: str) -> str:
        """Reason why a step is stale, in a few words."""
        names = list(dict.fromkeys(self.reasons.get(step, {}).values()))
        return ", ".join(names[:_MAX_NAMES]) + (" and more" if len(names) > _MAX_NAMES else "")

    @property
    def all_notes(self) -> list[str]:
        """Notes of all steps, those of the picture first."""
        return list(dict.fromkeys(text for step in sorted(self.notes, reverse=True) for text in self.notes[step]))

    @property
    def is_stale_by_gloss_alone(self) -> bool:
        """Whether all that does not fit is where gloss is seen from: all else of the light is as it would be now."""
        return self.stale == {"light"} and set(self.reasons["light"]) == {GLOSS_MOVED}
