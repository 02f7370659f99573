# SPDX-License-Identifier: GPL-3.0-or-later
"""Refined picture of a view: a share of its pixels, or all by samples per pixel, traced by its ranking."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..octree.octree import Octree
from ..runtime.progress import Steps
from ..tracing.camera import Camera
from ..tracing.pixel_filter import BOX_FILTER, GRID, PixelFilter
from .adaptive import REFINED_SIDE, Pace, first_rays, in_batches
from .errors import left_after
from .ranking import Ranking
from .sample_counts import COUNTS, pixels_by_side


@dataclass(frozen=True, eq=False)
class RefinedPicture:
    """Picture of P pixels after refinement.

    luminance: (P,) float32, plain means of each pixel's rays, which errors are of. colors: (P, 3) float32, linear, gray
    without colour, and alpha: (P,) float32, covered share, through the pixel filter. samples: (P,) int32, rays per
    pixel.
    """

    luminance: np.ndarray
    colors: np.ndarray
    alpha: np.ndarray
    samples: np.ndarray

    @property
    def refined_count(self) -> int:
        """Pixels that got more than one ray."""
        return int(np.count_nonzero(self.samples > 1))


def refined_view(
    octree: Octree,
    camera: Camera,
    ranking: Ranking,
    samples: np.ndarray,
    pixel_filter: PixelFilter = BOX_FILTER,
    *,
    pace: Pace | None = None,
    begun: Callable[[RefinedPicture], None] | None = None,
) -> Steps[RefinedPicture]:
    """Trace `samples` (P,) of the pixels of a ranked view, falling in its order; pixels of one sample are skipped.

    begun: called with the initial picture, whose pixels are then refined in place.
    """
    from .film import Film

    buffers = ranking.buffers
    luminance, film = buffers.shown.copy(), Film((camera.width_px, camera.height_px), pixel_filter)
    film.show(0, first_rays(octree, buffers))

    def take(pixels: np.ndarray, side: int) -> None:
        luminance[pixels] = film.trace(octree, camera, pixels, np.ones(len(pixels), np.int32), side, GRID)

    picture = RefinedPicture(luminance, film.values[:, :3], film.values[:, 3], samples)
    if begun is not None:
        begun(picture)
    yield from in_batches(pixels_by_side(samples, ranking.order), pace or Pace(), take)
    return picture


def samples_report(ranking: Ranking, refined: RefinedPicture) -> dict[str, Any]:
    """Figures of a refined picture, as plain JSON values; over active pixels.

    spent: mean samples. pixels: count for each number of samples. With a reference, mse: error after refinement;
    mse_of_share: error after spending the same rays, without the preview's, at 32x32 per pixel.
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
