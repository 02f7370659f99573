# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive super-sampling of a picture: one ray per pixel first, then more within a budget (methods 3, 7.25b), or
equally many in every pixel.

The picture is complete after every step, so a render engine can show intermediate results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..octree.octree import Octree
from ..process.segments import shared_zeros
from ..runtime.progress import Progress, Steps
from ..tracing.camera import Camera, camera_part
from ..tracing.pixel_filter import BOX_FILTER, EVEN, GRID, PixelFilter, RayPattern
from .pixel_buffers import PixelBuffers
from .predicted import PREVIEW
from .ranking import Ranking, rank
from .registry import STRATEGIES, strategy
from .sample_counts import pixels_by_side
from .strategy import Strategy
from .trace import trace_view

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree

BAND_PIXELS = 1 << 16  # traced at once
BATCH_RAYS = 1 << 20  # of refined pixels at once
REFINED_SIDE = 32  # rays per pixel side
Importance = Callable[[PixelBuffers], Steps[np.ndarray]]  # weights (P,) in [0, 1] of a traced view


@dataclass(frozen=True)
class Pace:
    """Amount of work in one step: pixels traced, and rays of pixels refined."""

    band_pixels: int = BAND_PIXELS
    batch_rays: int = BATCH_RAYS


@dataclass(frozen=True)
class PictureSettings:
    """Work on a picture by name and number, so that it can be sent to another process.

    strategy: name; None: `side` x `side` rays in all pixels. unrefined: see `PixelBuffers`. budget, spp, refined: see
    `AdaptivePicture.refine`.
    """

    strategy: str | None
    unrefined: str = PREVIEW
    budget: float = 0.0
    spp: float | None = None
    refined: float = REFINED_SIDE**2
    side: int = 1
    pixel_filter: PixelFilter = BOX_FILTER

    def picture(
        self, octree: Octree, camera: Camera, coded: CodedOctree | None, importance: Importance | None
    ) -> AdaptivePicture:
        """Picture to work on."""
        chosen = None if self.strategy is None else strategy(self.strategy)
        return AdaptivePicture(octree, camera, chosen, coded, importance, self.unrefined, self.pixel_filter)

    def more_rays(self, picture: AdaptivePicture, pace: Pace | None = None, side: int = REFINED_SIDE) -> Steps[None]:
        """Trace all rays after the first of each pixel. side: most per pixel side of those that a strategy refines."""
        if picture.strategy is None:
            yield from picture.sample_evenly(self.side, pace)
        else:
            yield from picture.refine(self.budget, side, pace, spp=self.spp, refined=self.refined)


class AdaptivePicture:
    """Picture of P pixels, row 0 at the bottom, with their current values through a pixel filter.

    values: (P, 4) float32, colours, linear as in the octree, not clamped, premultiplied by alpha; and alpha, the share
    of the rays that hit.
    samples: (P,) int32, rays per pixel; 0 before the first.
    Other processes can see values and samples while they change.
    buffers: set once all pixels are traced; `ranking` too, if there is a strategy.
    """

    def __init__(
        self,
        octree: Octree,
        camera: Camera,
        strategy: Strategy | None,
        coded: CodedOctree | None = None,
        importance: Importance | None = None,
        unrefined: str = PREVIEW,
        pixel_filter: PixelFilter = BOX_FILTER,
    ) -> None:
        """Prepare a picture; importance returns the weights that multiply the scores of a traced view; None: all 1.

        strategy: ranks pixels for `refine`; None for evenly sampled pictures.
        unrefined: value of pixels with one ray, see `PixelBuffers`.
        """
        self.octree, self.camera, self.strategy, self.coded = octree, camera, strategy, coded
        self._importance = importance
        self.unrefined = unrefined
        from .film import Film

        self._film = Film((camera.width_px, camera.height_px), pixel_filter, shared_zeros)
        self.values: np.ndarray = self._film.values
        self.samples: np.ndarray = shared_zeros((camera.pixel_count,), np.int32)
        self.buffers: PixelBuffers | None = None
        self.ranking: Ranking | None = None

    def trace(self, pace: Pace | None = None) -> Steps[None]:
        """Trace one ray per pixel in bands of rows, then compute importance and score of all pixels.

        Raises SettingError if the strategy or the value of unrefined pixels needs codes and there are none, and errors
        of the importance.
        """
        pace, camera, bands, wanted = pace or Pace(), self.camera, [], self._wanted()
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
        self.buffers, self.ranking = yield from self._ranked(bands)

    def refine(
        self,
        budget: float,
        side: int = REFINED_SIDE,
        pace: Pace | None = None,
        *,
        spp: float | None = None,
        refined: float = REFINED_SIDE**2,
    ) -> Steps[None]:
        """Refine the share `budget` of the active pixels, by falling priority.

        refined: mean samples of these pixels, spread over them by priority. spp: mean samples per active pixel instead
        of the budget (methods 7.25b). No pixel gets more than side x side rays; pixels that already have theirs are
        skipped. Pixels of importance 0 keep their one ray within any budget. Raises SettingError for a mean outside its
        bounds.
        """
        assert self.ranking is not None
        samples = self.ranking.refined_samples(refined, budget) if spp is None else self.ranking.samples(spp)
        groups = pixels_by_side(np.minimum(samples, side**2), self.ranking.order)
        missing = ((rays, pixels[self.samples[pixels] != rays**2]) for rays, pixels in groups)
        yield from in_batches(missing, pace or Pace(), self._take)

    def sample_evenly(self, side: int, pace: Pace | None = None) -> Steps[None]:
        """Trace side x side rays in all pixels, except those of importance 0 and those that already have as many.

        Rays have the footprint pixel / EVEN.footprints. Raises SettingError for a side outside 1 to 32.
        """
        assert self.buffers is not None
        importance = self.buffers.importance
        pixels = np.arange(len(self.samples)) if importance is None else np.flatnonzero(importance > 0)
        take = partial(self._take, pattern=EVEN)
        yield from in_batches([(side, pixels[self.samples[pixels] != side**2])], pace or Pace(), take)

    def _wanted(self) -> list[Strategy]:
        """Strategies whose inputs a traced view needs."""
        first = self.strategy
        if first is None:
            return []
        return [first] if self.coded is None else [first, STRATEGIES["patchnet"]]  # for coverage

    def _ranked(self, bands: list[PixelBuffers]) -> Steps[tuple[PixelBuffers, Ranking | None]]:
        """Join the bands into the whole view, and rank it by the strategy."""
        yield Progress(0, 1, "Ranking pixels")
        buffers = joined_buffers(bands)
        if self._importance is not None:
            buffers = replace(buffers, importance=(yield from self._importance(buffers)))
        if self.strategy is None:
            return buffers, None
        return buffers, rank(self.strategy, buffers)

    def _show(self, start: int, band: PixelBuffers) -> None:
        self._film.show(start, first_rays(self.octree, band))
        self.samples[start : start + len(band.preview)] = 1

    def _take(self, pixels: np.ndarray, side: int, pattern: RayPattern = GRID) -> None:
        self._film.trace(self.octree, self.camera, pixels, self.samples[pixels], side, pattern)
        self.samples[pixels] = side**2


def first_rays(octree: Octree, buffers: PixelBuffers) -> np.ndarray:
    """Colours and coverage (P, 4) float32 that pixels show by a single ray each, with light above white."""
    from ..tracing.render import seen_above_white

    above, seen = seen_above_white(octree, buffers.hits), buffers.shown_color
    if buffers.shows_predicted and buffers.prediction is not None:
        above *= buffers.prediction.coverage[:, None]
    colors = (buffers.shown[:, None] if seen is None else seen) + above
    return np.concatenate([colors, buffers.shown_alpha[:, None]], axis=1)


def in_batches(
    groups: Iterable[tuple[int, np.ndarray]], pace: Pace, take: Callable[[np.ndarray, int], None]
) -> Steps[None]:
    """Refine groups of pixels, each with its rays per pixel side, batch by batch; `take` traces pixels with so many.

    Progress counts rays.
    """
    groups = list(groups)
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
    """Join views of stacked bands, the lowest first, into one."""
    first = bands[0]
    height_px, camera_up = sum(band.height for band in bands), first.hits.camera_up
    joined = _joined_fields(bands)
    hits = joined["hits"]._replace(height_px=height_px, camera_up=camera_up)
    return PixelBuffers(**joined | {"hits": hits, "estimators": first.estimators})


def _joined(parts: list[Any]) -> Any:
    """Join one field of all views: concatenate arrays, also in tuples; other values come from the first view."""
    first = parts[0]
    if isinstance(first, np.ndarray):
        return np.concatenate(parts)
    if isinstance(first, tuple):
        return type(first)(*map(_joined, map(list, zip(*parts, strict=True))))
    if not is_dataclass(first) or isinstance(first, type):
        return first
    return replace(first, **_joined_fields(parts))


def _joined_fields(parts: list[Any]) -> dict[str, Any]:
    return {item.name: _joined([getattr(part, item.name) for part in parts]) for item in fields(parts[0])}
