# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds of a bake: which surfels get how many further paths (methods 7.2e)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .light_cells import LightCells

FIRST_SAMPLES, MORE = 4, 4  # paths of each surfel in the first round; factor of each further round on their number
_WHITE = 0.995  # quantile of radiance that a picture shows white
_LEAST_ROOT = 1e-2  # of the root of exposed radiance
_USUAL = 0.9  # share of the pixels that is less noisy than what is told of a picture


class Round(NamedTuple):
    """Round of a bake: number, from 0 on; surfels (n,) int64; paths of each, an even number."""

    number: int
    surfels: np.ndarray
    samples: int


def first_round(count: int, max_samples: int) -> Round:
    """Round of all surfels."""
    return Round(0, np.arange(count), min(FIRST_SAMPLES, max_samples) // 2 * 2)


def next_round(before: Round, cells: LightCells, threshold: float, max_samples: int) -> Round | None:
    """Round of those surfels of the last one whose cells are noisier than the threshold; None if there are none."""
    so_far = FIRST_SAMPLES * MORE**before.number
    chosen = before.surfels[picture_noise(cells)[before.surfels] > threshold]
    samples = (min(so_far * MORE, max_samples) - so_far) // 2 * 2
    return Round(before.number + 1, chosen, samples) if len(chosen) and samples > 0 else None


def picture_noise(cells: LightCells) -> np.ndarray:
    """Noise (R,) float32 of cells in a picture, 0 for cells that no camera sees.

    It is the standard deviation over the root of the radiance, both exposed, as in Cycles' adaptive sampling. That of
    a cell smaller than a pixel is averaged there.
    """
    seen = cells.pixels > 0.0
    if not seen.any():
        return np.zeros(len(cells.pixels), np.float32)
    shown = cells.radiance[seen]
    white = float(np.quantile(shown, _WHITE)) or float(shown.max())  # a lamp in the dark
    exposure = 1.0 / max(white, 1e-30)
    root = np.sqrt(np.maximum(cells.radiance * exposure, 0.0))
    noise = cells.noise * exposure / np.maximum(root, _LEAST_ROOT)
    return np.asarray(noise * np.sqrt(np.minimum(cells.pixels, 1.0)), np.float32)


def usual_noise(cells: LightCells) -> float:
    """`picture_noise` that nine of ten pixels of all cameras stay below."""
    noise = picture_noise(cells)
    order = np.argsort(noise)
    pixels = np.cumsum(cells.pixels[order], dtype=np.float64)
    if not len(order) or not pixels[-1] > 0.0:
        return 0.0
    return float(noise[order][np.searchsorted(pixels, _USUAL * pixels[-1])])
