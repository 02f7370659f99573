# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive super-sampling of a picture: one ray a pixel first, then more where the budget goes (methods 3, 7.25b), or
as many in every pixel.

The picture is there at any time between two steps, as good as it is by then: a render engine shows it meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..octree.octree import Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.progress import Progress, Steps
from ..runtime.worker import run_in_worker
from ..tracing.camera import Camera, camera_part
from .pixel_buffers import PixelBuffers
from .predicted import PREVIEW
from .refine import priority, refinement_order
from .registry import STRATEGIES
from .sample_counts import refined_in_order, runs_of_equal_counts, samples_in_order
from .staged_looks import TracedLooks
from .staged_strategy import StagedStrategy
from .strategy import Strategy
from .trace import trace_view

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree
    from ..codes.predict import Prediction
    from ..tracing.render import Hits

BAND_PIXELS = 1 << 16  # traced at once
BATCH_RAYS = 1 << 20  # of refined pixels at once
REFINED_SIDE = 32  # rays per pixel side
EVEN_FOOTPRINT = 16  # of pixels with as many rays each: a ray meets voxels of this part of a pixel. Coarser ones are
# too thick at edges, finer ones cost more than they show (docs/worth-it.md).
Importance = Callable[[PixelBuffers], Steps[np.ndarray]]  # weights (P,) in [0, 1] of a traced view


@dataclass
class Pace:
    """Amount of work in one step: pixels that are traced, and rays of pixels that are refined.

    It may be changed between two steps, by a caller that finds out on the way how long one takes.
    """

    band_pixels: int = BAND_PIXELS
    batch_rays: int = BATCH_RAYS


class AdaptivePicture:
    """Picture of P pixels, row 0 at the bottom, and what is known of them so far.

    colors: (P, 3) float32, linear as the octree's with what is above white, weighed by alpha over black.
    alpha: (P,) float32, share of the rays that met something.
    samples: (P,) int32, rays per pixel; 0 where nothing is traced yet.
    buffers, score: set once every pixel was traced: what strategies look at, and (P,) float32 scores.
    """

    def __init__(
        self,
        octree: Octree,
        camera: Camera,
        strategy: Strategy | None,
        coded: CodedOctree | None = None,
        importance: Importance | None = None,
        unrefined: str = PREVIEW,
        budget: float | None = None,
    ) -> None:
        """Prepare a picture; importance makes the weights that multiply scores of a traced view, None for 1.

        strategy: what `refine` ranks by; None for a picture that is only sampled evenly.
        unrefined: what pixels with one ray show, see `PixelBuffers`. budget: share of the active pixels that will be
        refined, for strategies that look at pixels in stages then; None: all pixels are looked at alike.
        """
        self.octree, self.camera, self.strategy, self.coded = octree, camera, strategy, coded
        self._importance = importance
        self.unrefined = unrefined
        self._budget = budget
        self.colors = np.zeros((camera.pixel_count, 3), np.float32)
        self.alpha = np.zeros(camera.pixel_count, np.float32)
        self.samples = np.zeros(camera.pixel_count, np.int32)
        self.buffers: PixelBuffers | None = None
        self.score: np.ndarray | None = None
        self._order: np.ndarray | None = None

    @property
    def priority(self) -> np.ndarray | None:
        """(P,) float32: what pixels are ranked by, their scores times what matters; None before there are scores."""
        return None if self.buffers is None or self.score is None else priority(self.buffers, self.score)

    def trace(self, pace: Pace | None = None) -> Steps[None]:
        """Trace one ray per pixel, band of rows by band of rows, then find importance and score of all pixels.

        Raises SettingError if the strategy, or what unrefined pixels show, needs codes and there are none, and what
        finding importance raises.
        """
        pace, camera, bands, wanted = pace or Pace(), self.camera, [], self._looks()
        row = 0
        while row < camera.height_px:
            yield Progress(row, camera.height_px, "Tracing the preview")
            rows = min(max(1, pace.band_pixels // camera.width_px), camera.height_px - row)
            part = camera_part(camera, 0, row, camera.width_px, rows)
            band = yield from trace_view(
                self.octree, part, wanted, coded=self.coded, reference=False, unrefined=self.unrefined
            )
            bands.append(band)
            self._show(row * camera.width_px, band)
            row += rows
        # Of all pixels at once, so as long as that takes: beside the caller that waits.
        ranked = yield from run_in_worker(lambda: self._ranked(bands), Progress(0, 1, "Ranking pixels"))
        self.buffers, self.score, self._order = ranked

    def refine(
        self,
        budget: float,
        side: int = REFINED_SIDE,
        pace: Pace | None = None,
        *,
        spp: float | None = None,
        refined: float = REFINED_SIDE**2,
    ) -> Steps[None]:
        """Refine the share `budget` of the active pixels, those of highest priority first.

        refined: mean samples of these pixels, spread over them by priority. spp: mean samples per active pixel instead
        of the budget (methods 7.25b). No pixel gets more than side x side rays, and those that have theirs already are
        left alone. Pixels of importance 0 keep their one ray, also where a budget would reach them. Raises SettingError
        for a budget or a mean outside its bounds.
        """
        buffers, order, ranked_by = self.buffers, self._order, self.priority
        assert buffers is not None and order is not None and ranked_by is not None
        if spp is None:
            counts = refined_in_order(buffers, ranked_by, order, budget, refined)
        else:
            counts = samples_in_order(buffers, ranked_by, order, spp)
        groups = self._chosen(counts, side)
        yield from in_batches(
            [(rays, pixels[self.samples[pixels] != rays**2]) for rays, pixels in groups], pace or Pace(), self._take
        )

    def sample_evenly(self, side: int, pace: Pace | None = None) -> Steps[None]:
        """Trace side x side rays in all pixels but those of importance 0 and those that have as many already.

        Rays have the footprint pixel / EVEN_FOOTPRINT. Raises SettingError for a side outside 1 to 32.
        """
        assert self.buffers is not None
        importance = self.buffers.importance
        pixels = np.arange(len(self.samples)) if importance is None else np.flatnonzero(importance > 0)
        take = partial(self._take, finer=max(side, EVEN_FOOTPRINT))
        yield from in_batches([(side, pixels[self.samples[pixels] != side**2])], pace or Pace(), take)

    def _looks(self) -> list[Strategy]:
        """Strategies whose looks a traced view needs."""
        if self.strategy is None:
            return []
        first = self.strategy if self._staged is None else self._staged.first_look()
        return [first] if self.coded is None else [first, STRATEGIES["patchnet"]]  # for coverage

    def _chosen(self, counts: np.ndarray, side: int) -> Iterator[tuple[int, np.ndarray]]:
        """Rays per pixel side, `side` at most, and the pixels that get so many."""
        order = self._order
        assert order is not None
        return ((rays, order[run]) for rays, run in runs_of_equal_counts(np.minimum(counts, side**2)))

    def _ranked(
        self, bands: list[PixelBuffers]
    ) -> Steps[tuple[PixelBuffers, np.ndarray | None, np.ndarray | None]]:
        """Whole view of its bands, the score of its pixels, and their order, these two with a strategy."""
        yield Progress(0, 1, "Ranking pixels")
        buffers = joined_buffers(bands)
        if self._importance is not None:
            buffers = replace(buffers, importance=(yield from self._importance(buffers)))
        if self.strategy is None:
            return buffers, None, None
        score = self._scores(buffers, self.strategy)
        return buffers, score, refinement_order(buffers, score)

    @property
    def _staged(self) -> StagedStrategy | None:
        """Strategy where it ranks in stages, which are of the preview's errors; None where all pixels are looked at."""
        known = self._budget is not None and self.unrefined == PREVIEW
        return self.strategy if known and isinstance(self.strategy, StagedStrategy) else None

    def _scores(self, buffers: PixelBuffers, strategy: Strategy) -> np.ndarray:
        staged = self._staged
        if staged is None or self._budget is None:
            return strategy.scores(buffers)
        lookahead = DEFAULT_LOOKAHEAD if self.coded is None else self.coded.weights.lookahead
        looks = TracedLooks(self.octree, self.camera, self.coded, lookahead, buffers.prediction)
        return staged.scores_within(buffers, looks, self._budget)

    def _show(self, start: int, band: PixelBuffers) -> None:
        rows = slice(start, start + len(band.preview))
        seen = band.shown_color
        above = self.octree.color_above_white(band.hits.node)
        if band.shows_predicted and band.prediction is not None:
            above *= band.prediction.coverage[:, None]
        self.colors[rows] = (band.shown[:, None] if seen is None else seen) + above
        self.alpha[rows] = band.shown_alpha
        self.samples[rows] = 1

    def _take(self, pixels: np.ndarray, side: int, finer: float | None = None) -> None:
        from ..tracing.supersample import supersample_pixels

        means = supersample_pixels(self.octree, self.camera, pixels, side, finer=finer)
        self.colors[pixels], self.alpha[pixels] = means.colors, means.coverage
        self.samples[pixels] = side**2


def in_batches(
    groups: Sequence[tuple[int, np.ndarray]], pace: Pace, take: Callable[[np.ndarray, int], None]
) -> Steps[None]:
    """Refine groups of pixels, each with its rays per pixel side, batch by batch; `take` traces pixels with so many.

    Progress counts rays. The pace is asked at each batch.
    """
    done, total = 0, sum(side**2 * len(pixels) for side, pixels in groups)
    for side, pixels in groups:
        start = 0
        while start < len(pixels):
            yield Progress(done, total, f"Refining {side}x{side}")
            batch = pixels[start : start + max(1, pace.batch_rays // side**2)]
            take(batch, side)
            start += len(batch)
            done += side**2 * len(batch)


def joined_buffers(bands: list[PixelBuffers]) -> PixelBuffers:
    """Join views that lie on top of each other, the lowest first, into one."""
    if len(bands) == 1:
        return bands[0]
    return PixelBuffers(
        hits=_joined_hits([band.hits for band in bands]),
        behind=_joined([band.behind for band in bands]),
        prediction=_joined_predictions([band.prediction for band in bands]),
        exact=_joined_predictions([band.exact for band in bands]),
        reference=_joined([band.reference for band in bands]),
        preview_color=_joined([band.preview_color for band in bands]),
        reference_color=_joined([band.reference_color for band in bands]),
        exact_1=_joined_predictions([band.exact_1 for band in bands]),
        normal=_joined([band.normal for band in bands]),
        fine=_joined([band.fine for band in bands]),
        fine_4=_joined([band.fine_4 for band in bands]),
        fine_rays=_joined([band.fine_rays for band in bands]),
        child_mask=_joined([band.child_mask for band in bands]),
        cube_side_world=bands[0].cube_side_world,
        scene_luminance=bands[0].scene_luminance,
        behind_color=_joined([band.behind_color for band in bands]),
        behind_hit=_joined([band.behind_hit for band in bands]),
        reference_alpha=_joined([band.reference_alpha for band in bands]),
        unrefined=bands[0].unrefined,
        estimators=bands[0].estimators,
    )


def _joined(arrays: list[np.ndarray | None]) -> np.ndarray | None:
    there = [array for array in arrays if array is not None]
    return np.concatenate(there) if there else None


def _joined_hits(parts: list[Hits]) -> Hits:
    first = parts[0]
    names = [name for name in vars(first) if name not in ("width_px", "height_px", "camera_up")]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return replace(first, height_px=sum(part.height_px for part in parts), **arrays)


def _joined_predictions(parts: list[Prediction | None]) -> Prediction | None:
    there = [part for part in parts if part is not None]
    if not there:
        return None
    arrays = {name: np.concatenate([getattr(part, name) for part in there]) for name in vars(there[0])}
    return replace(there[0], **arrays)
