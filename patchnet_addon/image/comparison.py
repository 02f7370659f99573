# SPDX-License-Identifier: GPL-3.0-or-later
"""Image metrics: differences in luminance between two pictures, by kind of region.

All pictures are (H, W) float32 of linear luminance in one exposure; the metrics clamp it to [0, 1] (methods 7.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..sampling.errors import psnr
from .colormaps import diverging
from .heatmap import magnify, with_legend
from .tone import gray

MAX_PSNR_DB = 120.0  # of equal pictures
SILHOUETTES, CREASES, SHADOWS, TEXTURES, SMOOTH = REGIONS = ("silhouettes", "creases", "shadows", "textures", "smooth")
_COVERAGE_STEP = 0.02
_DEPTH_STEP = 0.03  # of the depth itself, deviation from a plane
_NORMAL_STEP = 0.5
_LIGHT_STEP = 0.25  # of the light around
_COLOR_STEP = 0.10  # of the albedo around
_CREASE_REACH_PX = 2


@dataclass(frozen=True, eq=False)
class Guides:
    """Guide layers of the reference beside luminance, each (H, W) float32, `normal` (H, W, 3).

    coverage: of the reference. other_coverage: of the compared picture. depth: inf or huge for a miss.
    albedo: luminance of the diffuse colour.
    """

    coverage: np.ndarray
    other_coverage: np.ndarray
    depth: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray

    @property
    def both(self) -> np.ndarray:
        """(H, W) bool: pixels fully covered in both pictures."""
        return np.minimum(self.coverage, self.other_coverage) > 1.0 - 1e-3


def clamped(luminance: np.ndarray) -> np.ndarray:
    """Luminance in [0, 1], float64."""
    return np.clip(np.nan_to_num(np.asarray(luminance, np.float64)), 0.0, 1.0)


def picture_psnr(picture: np.ndarray, reference: np.ndarray, chosen: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio in dB for the peak 1, at most MAX_PSNR_DB, over all pixels or the `chosen` ones."""
    squared = (clamped(picture) - clamped(reference)) ** 2
    mse = float(np.mean(squared if chosen is None else squared[chosen])) if squared.size else 0.0
    return min(psnr(mse), MAX_PSNR_DB)


def mean_ratio(picture: np.ndarray, reference: np.ndarray, chosen: np.ndarray | None = None) -> float | None:
    """Mean luminance over that of the reference; None if the reference is black."""
    here = np.ones(np.shape(picture), bool) if chosen is None else chosen
    mine, its = float(clamped(picture)[here].sum()), float(clamped(reference)[here].sum())
    return mine / its if its > 0 else None


def flip(picture: np.ndarray, reference: np.ndarray) -> float | None:
    """Mean FLIP of the sRGB pictures at 67 pixels per degree; None without the package flip-evaluator.

    Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", HPG 2020.
    """
    try:
        import flip_evaluator
    except ImportError:
        return None
    pictures = [np.ascontiguousarray(gray(clamped(item))[::-1]) for item in (reference, picture)]
    return float(flip_evaluator.evaluate(*pictures, "LDR", applyMagma=False)[1])


def regions(reference: np.ndarray, guides: Guides) -> dict[str, np.ndarray]:
    """Masks (H, W) by name, every pixel in one: the first of REGIONS that it fits.

    silhouettes: coverage changes, or depth jumps. creases: two surfaces meet, where contact shadows and leaks are.
    shadows: light per albedo changes. textures: albedo changes. smooth: the rest.
    """
    albedo = guides.albedo
    light = np.where(albedo > 1e-3, reference / np.maximum(albedo, 1e-3), 0.0)
    missed = np.abs(guides.coverage - guides.other_coverage) > _COVERAGE_STEP
    bent = np.max([spread(guides.normal[..., axis]) for axis in range(3)], axis=0) > _NORMAL_STEP
    masks = {
        SILHOUETTES: missed | (spread(guides.coverage) > _COVERAGE_STEP) | widened(depth_edges(guides.depth), 1),
        CREASES: widened(bent, _CREASE_REACH_PX),
        SHADOWS: spread(light) > _LIGHT_STEP * (around(light) + 1e-3),
        TEXTURES: spread(albedo) > _COLOR_STEP * (around(albedo) + 1e-3),
        SMOOTH: np.ones(reference.shape, bool),
    }
    taken = np.zeros(reference.shape, bool)
    for name, mask in masks.items():
        masks[name] = mask & ~taken
        taken |= mask
    return masks


def depth_edges(depth: np.ndarray) -> np.ndarray:
    """(H, W) bool: depth deviates from a plane, whose 1/depth is linear over the picture."""
    near = 1.0 / np.maximum(np.where(np.isfinite(depth), depth, 1e30), 1e-30)
    edge = np.zeros(depth.shape, bool)
    for axis in range(2):
        padded = np.pad(near, [(1, 1) if each == axis else (0, 0) for each in range(2)], mode="edge")
        step = np.diff(padded, axis=axis)
        before, after = (np.take(step, range(k, k + depth.shape[axis]), axis) for k in range(2))
        slope = np.minimum(np.abs(before), np.abs(after))
        edge |= np.abs(after - before) > _DEPTH_STEP * near + 2.0 * slope
    return edge


def _windows(values: np.ndarray, reach: int = 1) -> np.ndarray:
    """(H, W, n, n) windows around every pixel, the border repeated."""
    side = 2 * reach + 1
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, reach, mode="edge"), (side, side))


def spread(values: np.ndarray) -> np.ndarray:
    """Range of values (H, W) in each 3x3 window."""
    windows = _windows(values)
    return windows.max(axis=(2, 3)) - windows.min(axis=(2, 3))


def around(values: np.ndarray) -> np.ndarray:
    """Mean (H, W) of each 3x3 window."""
    return _windows(values).mean(axis=(2, 3))


def widened(mask: np.ndarray, reach: int) -> np.ndarray:
    """(H, W) bool: a pixel of `mask` is at most `reach` pixels away, along both axes."""
    return _windows(mask, reach).any(axis=(2, 3))


def compare(picture: np.ndarray, reference: np.ndarray, guides: Guides) -> dict[str, Any]:
    """Compare a picture with its reference: all figures, as plain JSON values.

    regions: share of pixels, share of the squared error, and the mean luminance ratio, by name of region.
    """
    error = clamped(picture) - clamped(reference)
    squared, total = error**2, float(np.sum(error**2)) or 1.0
    both = guides.both
    return {
        "psnr_db": picture_psnr(picture, reference),
        "mean_ratio": mean_ratio(picture, reference),
        "psnr_where_both_hit_db": picture_psnr(picture, reference, both) if both.any() else None,
        "mean_ratio_where_both_hit": mean_ratio(picture, reference, both) if both.any() else None,
        "both_hit_share": float(both.mean()),
        "flip": flip(picture, reference),
        "regions": {
            name: {
                "pixels": float(mask.mean()),
                "error": float(squared[mask].sum()) / total,
                "mean_ratio": mean_ratio(picture, reference, mask),
            }
            for name, mask in regions(reference, guides).items()
        },
    }


def difference_picture(difference: np.ndarray, maximum: float, title: str, quantity: str) -> np.ndarray:
    """Blue where `difference` is negative, red where it is positive, pale where it is 0; legend to +-`maximum`."""
    return with_legend([_signed(difference, maximum)], [title], _ramp, _ticks(maximum), quantity)


def side_by_side(
    reference: np.ndarray, picture: np.ndarray, maximum: float, titles: tuple[str, str, str]
) -> np.ndarray:
    """Reference, picture, and their difference (picture minus reference), with its legend."""
    views = [magnify(gray(reference)), magnify(gray(picture)), _signed(picture - reference, maximum)]
    return with_legend(views, list(titles), _ramp, _ticks(maximum), "luminance, octree less Cycles")


def _signed(difference: np.ndarray, maximum: float) -> np.ndarray:
    return magnify(diverging(difference / np.float32(maximum)))


def _ramp(position: np.ndarray) -> np.ndarray:
    return diverging(2.0 * position - 1.0)


def _ticks(maximum: float) -> list[str]:
    return [f"{maximum * share:.3g}" for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
