# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixel buffers of one view of a scene: all inputs of strategies, pure data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .predicted import PREDICTED, PREVIEW, expected_colors, expected_luminance

if TYPE_CHECKING:
    from ..codes.prediction import Prediction
    from ..tracing.hits import Hits
    from .plus.weights import Estimators


@dataclass(frozen=True, eq=False)
class PixelBuffers:
    """Picture of P = height x width pixels, row-major, row 0 at the bottom; luminances are linear, in [0, 1].

    hits: first hits of the pixel-centre rays; their luminance is the preview L1.
    behind: (P,) float32, L_B, luminance behind the patch (methods 3.12).
    fine: (P,) float32, luminance of the pixel's centre with a footprint finer by the look-ahead (methods 10).
    fine_rays: (P, 4) float32, luminances of 2x2 such rays in the pixel, lower row first, left to right.
    prediction: coverage and luminance decoded by the network (methods 4.1b).
    exact: the same two, rendered from the patch itself (methods 9).
    reference: (P,) float32, L32, 32x32 samples (methods 7.5). reference_alpha: (P,) float32, share of them that hit.
    preview_color, reference_color: (P, 3) float32, linear, of those luminances, for display; None without colour.
    Scores and errors use luminance only.
    behind_color: (P, 3) float32, linear, of `behind`. behind_hit: (P,) bool, that ray hits.
    unrefined: picture shown in unrefined pixels, PREVIEW or PREDICTED; errors and scores refer to it.
    exact_1: as `exact`, of the patch one level ahead: the children of the voxel and of its neighbours (methods 3.8).
    normal: (P, 3) float32, normalized mean normal of the hit voxel; 0 for a miss, and where normals cancel.
    child_mask: (P,) uint8, children of the hit voxel, bit x + 2y + 4z; 0 for a leaf and for a miss.
    cube_side_world: side of the octree's cube, the unit of distances.
    scene_luminance: mean luminance of the octree's surfaces, from its root.
    estimators: error estimators from the weights file; None: the shipped ones.
    importance: (P,) float32 in [0, 1], multiplies priorities; 0 is never refined. None: 1 everywhere.
    """

    hits: Hits
    behind: np.ndarray | None = None
    prediction: Prediction | None = None
    exact: Prediction | None = None
    reference: np.ndarray | None = None
    preview_color: np.ndarray | None = None
    reference_color: np.ndarray | None = None
    importance: np.ndarray | None = None
    fine: np.ndarray | None = None
    fine_rays: np.ndarray | None = None
    exact_1: Prediction | None = None
    normal: np.ndarray | None = None
    child_mask: np.ndarray | None = None
    cube_side_world: float | None = None
    scene_luminance: float | None = None
    behind_color: np.ndarray | None = None
    behind_hit: np.ndarray | None = None
    reference_alpha: np.ndarray | None = None
    unrefined: str = PREVIEW
    estimators: Estimators | None = None

    @property
    def height(self) -> int:
        """Rows of the picture."""
        return self.hits.height_px

    @property
    def width(self) -> int:
        """Columns of the picture."""
        return self.hits.width_px

    @property
    def hit(self) -> np.ndarray:
        """(P,) bool: the pixel's ray hits a voxel."""
        return self.hits.hit

    @property
    def preview(self) -> np.ndarray:
        """(P,) float32, L1: luminance of the first voxel, or the background (methods 7.5)."""
        return self.hits.luminance

    @cached_property
    def predicted(self) -> np.ndarray | None:
        """(P,) float32: luminance expected by the network, see `expected_luminance`; None if its inputs are missing."""
        if self.prediction is None or self.behind is None:
            return None
        return expected_luminance(self.prediction, self.behind)

    @cached_property
    def predicted_color(self) -> np.ndarray | None:
        """(P, 3) float32: linear colours of `predicted`; None without colour."""
        if self.prediction is None or self.preview_color is None or self.behind_color is None:
            return None
        return expected_colors(self.prediction, self.preview, self.preview_color, self.behind_color)

    @property
    def shows_predicted(self) -> bool:
        """Whether unrefined pixels show the predicted picture."""
        return self.unrefined == PREDICTED

    @property
    def shown(self) -> np.ndarray:
        """(P,) float32: luminance of the picture without refinement."""
        if not self.shows_predicted:
            return self.preview
        assert self.predicted is not None  # callers trace its inputs first
        return self.predicted

    @property
    def shown_color(self) -> np.ndarray | None:
        """(P, 3) float32: linear colours of `shown`; None without colour."""
        return self.predicted_color if self.shows_predicted else self.preview_color

    @property
    def preview_alpha(self) -> np.ndarray:
        """(P,) float32: 1 where the pixel's ray hits, else 0."""
        return self.hit.astype(np.float32)

    @property
    def predicted_alpha(self) -> np.ndarray | None:
        """(P,) float32: predicted covered share of each pixel; None if its inputs are missing."""
        if self.prediction is None or self.behind_hit is None:
            return None
        coverage = self.prediction.coverage
        return np.where(self.hit, coverage + (1.0 - coverage) * self.behind_hit, np.float32(0.0))

    @property
    def shown_alpha(self) -> np.ndarray:
        """(P,) float32: covered share of each pixel of `shown`."""
        if not self.shows_predicted:
            return self.preview_alpha
        assert self.predicted_alpha is not None
        return self.predicted_alpha

    @cached_property
    def active(self) -> np.ndarray:
        """(P,) bool: pixels that take part in budgets and errors (methods 7.23)."""
        return active_pixels(self.hit.reshape(self.height, self.width)).ravel()

    @property
    def lookahead_share(self) -> float | None:
        """Share of hit pixels whose voxel has descendants to look ahead to (methods 4.1b).

        None without a prediction, 0 without a hit.
        """
        if self.prediction is None:
            return None
        return float(self.prediction.look_ahead[self.hit].mean()) if self.hit.any() else 0.0

    def picture(self, values: np.ndarray) -> np.ndarray:
        """Values (P,) or (P, C) of the pixels as a picture (H, W) or (H, W, C)."""
        return values.reshape(self.height, self.width, *values.shape[1:])


def active_pixels(hit: np.ndarray) -> np.ndarray:
    """(H, W) bool: a pixel of `hit` (H, W) bool is active if it or any of its 8 neighbours is set."""
    padded = np.pad(hit, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]  # (H, W + 2)
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]
