# SPDX-License-Identifier: GPL-3.0-or-later
"""Refined picture of a view: a share of its pixels, or all by samples per pixel, traced as its ranking says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..octree.octree import Octree
from ..runtime.progress import Steps
from ..tracing.camera import Camera
from .adaptive import REFINED_SIDE, Pace, in_batches
from .errors import left_after
from .ranking import Ranking
from .sample_counts import COUNTS, runs_of_equal_counts


@dataclass(frozen=True, eq=False)
class RefinedPicture:
    """Picture of P pixels after its budget is spent.

    luminance: (P,) float32. colors: (P, 3) float32 linear, None without colour. alpha: (P,) float32, share of the pixel
    in which something is met. samples: (P,) int32, rays per pixel.
    """

    luminance: np.ndarray
    colors: np.ndarray | None
    alpha: np.ndarray
    samples: np.ndarray

    @property
    def refined_count(self) -> int:
        """Pixels that got more than one ray."""
        return int(np.count_nonzero(self.samples > 1))


Begun = Callable[[RefinedPicture], None]


def refined_by_share(
    octree: Octree,
    camera: Camera,
    ranking: Ranking,
    mean: float,
    pace: Pace | None = None,
    begun: Begun | None = None,
) -> Steps[RefinedPicture]:
    """Trace the share of a view's pixels that its ranking's budget refines, with `mean` samples each on average.

    begun: is given the picture at first, whose pixels then are refined in place. Raises SettingError for a mean outside
    16 to 1024.
    """
    return (yield from _traced(octree, camera, ranking, ranking.refined_samples(mean), pace, begun))


def refined_by_samples(
    octree: Octree,
    camera: Camera,
    ranking: Ranking,
    mean: float,
    pace: Pace | None = None,
    begun: Begun | None = None,
) -> Steps[RefinedPicture]:
    """Trace `mean` samples per active pixel of a ranked view, spread by priority (methods 7.25b).

    begun: as for `refined_by_share`. Raises SettingError for a mean outside 1 to 1024.
    """
    return (yield from _traced(octree, camera, ranking, ranking.samples(mean), pace, begun))


def _traced(
    octree: Octree, camera: Camera, ranking: Ranking, samples: np.ndarray, pace: Pace | None, begun: Begun | None
) -> Steps[RefinedPicture]:
    """Picture whose pixels have `samples` (P,), which fall in the ranking's order."""
    from ..tracing.supersample import supersample_pixels

    buffers, order = ranking.buffers, ranking.order
    luminance, alpha = buffers.shown.copy(), buffers.shown_alpha.copy()
    colors = None if buffers.shown_color is None else buffers.shown_color.copy()

    def take(pixels: np.ndarray, side: int) -> None:
        means = supersample_pixels(octree, camera, pixels, side)
        luminance[pixels], alpha[pixels] = means.luminance, means.coverage
        if colors is not None:
            colors[pixels] = means.colors

    refined = RefinedPicture(luminance, colors, alpha, samples)
    if begun is not None:
        begun(refined)
    groups = [(side, order[run]) for side, run in runs_of_equal_counts(samples[order])]
    yield from in_batches(groups, pace or Pace(), take)
    return refined


def samples_report(ranking: Ranking, refined: RefinedPicture) -> dict[str, Any]:
    """Figures of a refined picture, as plain JSON values; over active pixels.

    spent: mean samples. pixels: with each number of samples. With a reference, mse: the error left; mse_of_share: what
    is left by 32x32 rays in as many pixels as the same rays pay for, the preview's own not counted.
    """
    buffers, order = ranking.buffers, ranking.order
    samples, active = refined.samples[order], max(len(order), 1)
    report: dict[str, Any] = {
        "spent": float(samples.sum(dtype=np.int64) / active),
        "pixels": {str(count): int(np.count_nonzero(samples == count)) for count in COUNTS},
    }
    if buffers.reference is not None:
        error = (refined.luminance[order].astype(np.float64) - buffers.reference[order]) ** 2
        share = int(samples[samples > 1].sum(dtype=np.int64)) / REFINED_SIDE**2 / active
        report["mse"] = float(error.sum() / active)
        report["mse_of_share"] = float(left_after(buffers, order, [share])[0])
    return report
