# SPDX-License-Identifier: GPL-3.0-or-later
"""Refined picture of a view that has its reference: by a share of its pixels, or by samples per pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..octree.octree import Octree
from ..runtime.progress import Steps
from ..tracing.camera import Camera
from .adaptive import REFINED_SIDE, Pace, in_batches
from .errors import left_after
from .ranking import Ranking
from .refine import refined_colors, refined_picture
from .sample_counts import COUNTS, runs_of_equal_counts


@dataclass(frozen=True, eq=False)
class RefinedPicture:
    """Picture of P pixels after its budget is spent.

    luminance: (P,) float32. colors: (P, 3) float32 linear, None without colour. samples: (P,) int32, rays per pixel.
    """

    luminance: np.ndarray
    colors: np.ndarray | None
    samples: np.ndarray

    @property
    def refined_count(self) -> int:
        """Pixels that got more than one ray."""
        return int(np.count_nonzero(self.samples > 1))


def refined_by_share(ranking: Ranking) -> RefinedPicture:
    """Take the reference for the share of the pixels that the ranking's budget refines."""
    buffers, mask = ranking.buffers, ranking.mask
    colored = buffers.shown_color is not None and buffers.reference_color is not None
    return RefinedPicture(
        luminance=refined_picture(buffers, mask),
        colors=refined_colors(buffers, mask) if colored else None,
        samples=np.where(mask, REFINED_SIDE**2, 1).astype(np.int32),
    )


def refined_by_samples(
    octree: Octree, camera: Camera, ranking: Ranking, mean: float, pace: Pace | None = None
) -> Steps[RefinedPicture]:
    """Trace `mean` samples per active pixel of a ranked view, spread by priority (methods 7.25b).

    Raises SettingError for a mean outside 1 to 1024.
    """
    from ..tracing.pixels import supersample_pixels

    buffers, order = ranking.buffers, ranking.order
    samples = ranking.samples(mean)
    luminance = buffers.shown.copy()
    colors = None if buffers.shown_color is None else buffers.shown_color.copy()

    def take(pixels: np.ndarray, side: int) -> None:
        means = supersample_pixels(octree, camera, pixels, side)
        luminance[pixels] = means.luminance
        if colors is not None:
            colors[pixels] = means.colors

    groups = [(side, order[run]) for side, run in runs_of_equal_counts(samples[order])]
    yield from in_batches(groups, pace or Pace(), take)
    return RefinedPicture(luminance, colors, samples)


def samples_report(ranking: Ranking, refined: RefinedPicture, mean: float) -> dict[str, Any]:
    """Figures of a picture that `refined_by_samples` made for a `mean`, as plain JSON values; over active pixels.

    spent: mean samples. pixels: with each number of samples. mse: the error left. mse_of_share: what is left by 32x32
    rays in as many pixels as the same rays pay for, the preview's own not counted.
    """
    buffers, order = ranking.buffers, ranking.order
    assert buffers.reference is not None
    samples, active = refined.samples[order], max(len(order), 1)
    error = (refined.luminance[order].astype(np.float64) - buffers.reference[order]) ** 2
    share = int(samples[samples > 1].sum(dtype=np.int64)) / REFINED_SIDE**2 / active
    return {
        "budget": mean,
        "spent": float(samples.sum(dtype=np.int64) / active),
        "pixels": {str(count): int(np.count_nonzero(samples == count)) for count in COUNTS},
        "mse": float(error.sum() / active),
        "mse_of_share": float(left_after(buffers, order, [share])[0]),
    }
