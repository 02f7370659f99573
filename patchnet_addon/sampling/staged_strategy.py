# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies that rank in stages: one finer ray for all pixels, then closer looks at those near the budget's cut.

A finer ray already separates pixels that are surely refined within a budget from those that surely are not. Only pixels
between get the ray behind their patch, the network, four more rays (methods 12.5).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..octree.octree import Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..tracing.camera import Camera
from .pixel_buffers import PixelBuffers, active_pixels
from .plus.forms import Form
from .refine import priority, refined_count
from .strategy import BEHIND, CHILD_MASK, FINE, FINE_RAYS, NORMAL, PREDICTION, Strategy
from .trace import seen_children, seen_normal

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree
    from ..tracing.render import Hits
    from .plus.weights import Estimators

SUFFIX = "-staged"  # of names
VARIANCE_SHARE = 1 / 16
"""Share of the variance of 3x3 pixels beside the finer ray's squared difference in the first score."""
_TINY = np.finfo(np.float32).tiny
_BESIDE = 1e-6  # relative distance from the cut of scores moved above or below it

# Results of each look, as parts of `PixelBuffers`.
_FOUND = {
    NORMAL: (NORMAL,),
    CHILD_MASK: (CHILD_MASK,),
    BEHIND: (BEHIND, "behind_hit"),
    FINE_RAYS: (FINE_RAYS,),
    PREDICTION: (PREDICTION,),
}


@dataclass(frozen=True, eq=False)
class Looks:
    """Closer looks at chosen pixels (N,) of a view by index, traced and decoded for these only.

    coded: codes of the octree; None if no prediction is needed.
    """

    octree: Octree
    camera: Camera
    coded: CodedOctree | None

    def look(self, part: str, hits: Hits, pixels: np.ndarray) -> Sequence[Any]:
        """Compute a part of `PixelBuffers`, with those of the same look (`_FOUND`)."""
        from ..codes.predict import predict  # compiled code, which registration must not load
        from ..tracing.chosen import fine_rays
        from ..tracing.supersample import behind_patches

        if part == NORMAL:
            return (seen_normal(self.octree, hits.node[pixels]),)
        if part == CHILD_MASK:
            return (seen_children(self.octree, hits.node[pixels]),)
        if part == PREDICTION:
            assert self.coded is not None  # plans of stages require codes
            return (predict(self.coded, hits.part(pixels)),)
        lookahead = DEFAULT_LOOKAHEAD if self.coded is None else self.coded.weights.lookahead
        if part == FINE_RAYS:
            return (fine_rays(self.octree, self.camera, pixels, lookahead=lookahead),)
        behind = behind_patches(self.octree, self.camera, hits, pixels, lookahead=lookahead)
        return behind.luminance, behind.coverage > 0.0


class KnownPixels:
    """View with further inputs for some pixels and defaults for all others.

    Defaults: a whole patch as bright as its voxel, nothing behind it, and finer rays equal to the one in the pixel's
    centre. The estimator reads them in the windows of scored pixels; most relevant neighbours have real values.
    """

    def __init__(self, buffers: PixelBuffers, looks: Looks | None) -> None:
        """Start from a view with hits and the finer ray in each pixel's centre.

        Other buffers of the view are read instead of a look. looks: None if the view has everything.
        """
        self._buffers, self._looks = buffers, looks
        self._view = PixelBuffers(
            buffers.hits,
            fine=buffers.fine,
            cube_side_world=buffers.cube_side_world,
            scene_luminance=buffers.scene_luminance,
        )
        self._looked: dict[str, np.ndarray] = {}

    def estimate(self, form: Form, pixels: np.ndarray, estimators: Estimators) -> np.ndarray:
        """Expected errors (N,) float32 of the preview in pixels (N,), after looking up the inputs of `form` there."""
        from .plus_planes import estimated_error  # compiled code, as above

        there = np.zeros(len(self._view.preview), bool)
        there[pixels] = True
        self._look_at(form, pixels, there)
        return estimated_error(self._view, estimators, form, there)[pixels]

    def _look_at(self, form: Form, pixels: np.ndarray, there: np.ndarray) -> None:
        """Look at pixels (N,), and at the normals in their windows; there: (P,) bool, where the pixels are."""
        if form.surface:
            self._look_for(NORMAL, np.flatnonzero(active_pixels(self._view.picture(there))))
            self._look_for(CHILD_MASK, pixels)
        if form.behind:
            self._look_for(BEHIND, pixels)
        if form.rays == 4:
            self._look_for(FINE_RAYS, pixels)
        if form.network:
            self._look_for(PREDICTION, pixels)
            self._view = replace(self._view)  # a new object has no cached prediction

    def _look_for(self, part: str, pixels: np.ndarray) -> None:
        """Write a part, and those of the same look, into the view at those of pixels (N,) that have only defaults."""
        if part not in self._looked:
            self._looked[part] = np.zeros(len(self._view.preview), bool)
            self._view = replace(self._view, **self._stand_ins(part))
        new = pixels[~self._looked[part][pixels]]
        if not len(new):
            return
        self._looked[part][new] = True
        known = [getattr(self._buffers, name) for name in _FOUND[part]]
        if known[0] is not None:
            found: Sequence[Any] = [values[new] for values in known]
        else:
            assert self._looks is not None
            found = self._looks.look(part, self._view.hits, new)
        for name, values in zip(_FOUND[part], found, strict=True):
            getattr(self._view, name)[new] = values

    def _stand_ins(self, part: str) -> dict[str, Any]:
        """Defaults of all pixels for a part, and for those of the same look."""
        from ..codes.predict import Prediction  # compiled code, as above

        view, count = self._view, len(self._view.preview)
        if part == NORMAL:
            return {NORMAL: np.zeros((count, 3), np.float32)}
        if part == CHILD_MASK:
            return {CHILD_MASK: np.zeros(count, np.uint8)}
        if part == BEHIND:
            return {BEHIND: np.zeros(count, np.float32), "behind_hit": np.zeros(count, bool)}
        if part == FINE_RAYS:
            assert view.fine is not None
            return {FINE_RAYS: np.repeat(view.fine, 4).reshape(-1, 4)}
        return {PREDICTION: Prediction(np.ones(count, np.float32), view.preview.copy(), np.zeros(count, bool))}


@dataclass(frozen=True)
class Stage:
    """Stage of a ranking.

    form: of the estimator that scores the pixels that take part. sure, reached: bounds of their rank by the previous
    scores, over the number of pixels that the budget refines. Pixels before `sure` are refined.
    """

    form: Form
    sure: float
    reached: float


@dataclass(frozen=True)
class Plan:
    """Plan of a ranking.

    stages: those after the first score, by one finer ray per pixel. around: the first score includes a share of the
    window's variance.
    """

    stages: tuple[Stage, ...]
    around: bool = True


def staged_scores(
    buffers: PixelBuffers, looks: Looks | None, plan: Plan, budget: float, estimators: Estimators
) -> np.ndarray:
    """Scores (P,) float32 of the preview's pixels, by which a share `budget` of the active ones is refined.

    Pixels of the last stage have their expected error. All others keep the score of an earlier stage, above or below
    the cut: only the order about the cut affects the error. buffers: hits, the first finer ray, importance, and the
    inputs of `KnownPixels`. looks: None if these suffice.
    """
    pool = np.flatnonzero(buffers.active)
    refined = refined_count(buffers, budget, len(pool))
    score = first_scores(buffers, around=plan.around)
    known = KnownPixels(buffers, looks)
    sure = pool[:0]
    for stage in plan.stages:
        last = len(pool) if math.isinf(stage.reached) else math.ceil(stage.reached * refined) - len(sure)
        first = math.floor(stage.sure * refined) - len(sure)
        above, pool = _between(pool, priority(buffers, score), first, last)
        sure = np.concatenate([sure, above])
        if not len(pool):
            break
        score[pool] = known.estimate(stage.form, pool, estimators)
    _keep_apart(score, priority(buffers, score), sure, pool, refined)
    return score


def first_scores(buffers: PixelBuffers, *, around: bool = True) -> np.ndarray:
    """Scores (P,) float32 of all active pixels by their finer ray's difference.

    Includes a share of the window's variance if `around`.
    """
    from .window_variance import window_variance  # compiled code, which registration must not load

    assert buffers.fine is not None
    difference = buffers.preview - buffers.fine
    if not around:
        return np.where(buffers.active, np.abs(difference), np.float32(0.0))
    variance = window_variance(buffers.picture(buffers.preview)).ravel().astype(np.float32)
    variance *= np.float32(VARIANCE_SHARE)
    squared = np.multiply(difference, difference, out=difference)
    squared += variance
    score: np.ndarray = np.sqrt(squared, out=squared)
    score *= buffers.active
    return score


def _between(pixels: np.ndarray, urgency: np.ndarray, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """Split pixels (N,) by falling urgency (P,): the `first`, and those up to the `last`, each in rising order."""
    last = min(max(last, 0), len(pixels))
    first = min(max(first, 0), last)
    cuts = [cut for cut in (first, last) if 0 < cut < len(pixels)]
    if cuts:
        pixels = pixels[np.argpartition(-urgency[pixels], cuts)]
    return pixels[:first], np.sort(pixels[first:last])


def _keep_apart(score: np.ndarray, urgency: np.ndarray, sure: np.ndarray, pool: np.ndarray, refined: int) -> None:
    """Change scores (P,) so that the budget refines the pixels `sure`, and otherwise only pixels of the `pool`.

    urgency: (P,) scores times importance.
    """
    left = refined - len(sure)
    if not 0 < left <= len(pool):
        return
    cut = np.partition(urgency[pool], len(pool) - left)[len(pool) - left]
    others = np.ones(len(score), bool)
    others[sure] = others[pool] = False
    high = np.flatnonzero(others & (urgency >= cut))
    low = sure[urgency[sure] <= cut]
    score[high] *= np.float32(1.0 - _BESIDE) * cut / np.maximum(urgency[high], _TINY)
    score[low] *= np.float32(1.0 + _BESIDE) * cut / np.maximum(urgency[low], _TINY)


@dataclass(frozen=True)
class StagedStrategy(Strategy):
    """Strategy of the error estimator that ranks in stages within a budget.

    plan: stages for a budget. Without a budget, `scores` treats all pixels alike.
    """

    plan: Callable[[float], Plan] = lambda _budget: Plan(())

    @property
    def cost(self) -> str:
        """Cost of the score in words: rays of pixels with the fewest and with all looks."""
        return f"2 to {1 + self.extra_rays} rays a pixel"

    def first_look(self) -> Strategy:
        """Strategy with the needs of the first score within a budget: the finer ray of every pixel."""
        return replace(self, needs=frozenset({FINE}))

    def scores_within(self, buffers: PixelBuffers, budget: float, looks: Looks | None = None) -> np.ndarray:
        """(P,) float32 scores of a view, of which a share `budget` of the active pixels is refined.

        buffers: as of `first_look`; buffers that hold all pixels are not computed again. looks: None if they hold all
        needs of the strategy.
        """
        from .plus.weights import shipped_estimators

        estimators = buffers.estimators or shipped_estimators()
        return staged_scores(buffers, looks, self.plan(budget), budget, estimators)


def in_stages(strategy: Strategy, plan: Callable[[float], Plan]) -> StagedStrategy:
    """Copy of a strategy with a plan for budgets, named `NAME-staged`."""
    same = {field.name: getattr(strategy, field.name) for field in fields(Strategy)}
    staged = {
        "name": strategy.name + SUFFIX,
        "title": f"{strategy.title}, in stages",
        "description": f"{strategy.title} with fewer rays for pixels of clear rank; choose it to save time",
    }
    return StagedStrategy(**same | staged, plan=plan)
