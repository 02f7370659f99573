# SPDX-License-Identifier: GPL-3.0-or-later
"""Result of a scene: its octree, light and codes, what was measured on views, and what of it is stale."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..state.gloss_view import GLOSS_MOVED

if TYPE_CHECKING:
    from ...patchnet_addon.codes.coded_octree import CodedOctree
    from ...patchnet_addon.octree.leaf_levels import LeafLevels
    from ...patchnet_addon.octree.octree import Octree
    from ..state.scene_state import SceneState

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
    stale: the steps whose input changed since: "surface", "light". reasons: names of what changed, by step, and for
    the pictures, "view", which make nothing else stale.
    made_with: the scene's settings when each step was done, by step. state: of the scene when it was read for them,
    None where nothing was compared with it.
    notes: sentences on what was left out or is approximate, by the step that they are of: "octree", "codes", "view".
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
    notes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    summary: list[str] = field(default_factory=list)

    def mark(self, step: str, what: str) -> None:
        """Mark a step, or the "view", as stale because of `what`; a few names are kept."""
        if step != VIEW:
            self.stale.add(step)
        names = self.reasons.setdefault(step, [])
        if what not in names and len(names) <= _MAX_NAMES:
            names.append(what)

    def known_changes(self) -> set[str]:
        """Names of what is marked already, which need no second look."""
        return {what for names in self.reasons.values() for what in names}

    def unmark(self, step: str) -> None:
        """Take back that a step is stale."""
        self.stale.discard(step)
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
        """Whether all that does not fit is where gloss is seen from: all else of the light is as it would be now."""
        return self.stale == {"light"} and self.reasons.get("light") == [GLOSS_MOVED]

    @property
    def nbytes(self) -> int:
        """Bytes that the result holds."""
        return self.octree.nbytes + (self.coded.nbytes if self.coded else 0)
