# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixel filters of Cycles: how much a ray counts in the pixels around it (methods 7.5b).

A picture shows its samples through a filter that is wider than a pixel. Rays are spread evenly over their own pixel,
and each counts in all pixels whose filter reaches it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

BOX, GAUSSIAN, BLACKMAN_HARRIS = "BOX", "GAUSSIAN", "BLACKMAN_HARRIS"  # as Cycles names them
_BLACKMAN_HARRIS = (0.35875, -0.48829, 0.14128, -0.01168)
_STEPS = 256  # of the integral over a pixel
EVEN_FOOTPRINT = 32  # coarser ones thicken edges (docs/worth-it.md)


class PixelFilter(NamedTuple):
    """Filter, the same along both axes; `width_px` as Cycles means it, of no effect on a box, which is a pixel wide."""

    kind: str = BOX
    width_px: float = 1.0

    @property
    def reach_px(self) -> float:
        """Distance from a pixel's centre to which its filter reaches."""
        return {BOX: 0.5, GAUSSIAN: 1.5 * self.width_px, BLACKMAN_HARRIS: self.width_px}[self.kind]

    @property
    def radius(self) -> int:
        """Pixels on each side of one that its rays count in."""
        return max(math.ceil(self.reach_px - 0.5 - 1e-9), 0)

    def at(self, distance_px: np.ndarray) -> np.ndarray:
        """Value of the filter, at most 1, at distances from a pixel's centre along one axis."""
        inside = np.abs(distance_px) <= self.reach_px
        if self.kind == BOX:
            return inside.astype(np.float64)
        share = distance_px / self.width_px
        if self.kind == GAUSSIAN:
            return np.where(inside, np.exp(-8.0 * share**2), 0.0)
        angle = np.pi * (share + 1.0)  # of a window of twice the width
        return np.where(inside, sum(term * np.cos(k * angle) for k, term in enumerate(_BLACKMAN_HARRIS)), 0.0)

    def shares(self) -> np.ndarray:
        """Share (2 r + 1,) of each pixel along one axis in the filter of the middle one; the sum is 1."""
        within = (np.arange(_STEPS) + 0.5) / _STEPS - 0.5
        apart = np.arange(-self.radius, self.radius + 1)
        sums = self.at(apart[:, None] + within).sum(axis=1)
        return sums / sums.sum()


BOX_FILTER = PixelFilter()


class Splat(NamedTuple):
    """Rays of a pixel, and how they count in those around it.

    places: (n, 2) float64 of the rays in the pixel, [0, 1]^2. weights: (K + 1, n) float64 of each ray in each pixel
    around, the lowest row first, and in a plain mean. total: (K + 1,), what weighted sums over the rays are divided by.
    """

    places: np.ndarray
    weights: np.ndarray
    total: np.ndarray


def grid_places(side: int) -> np.ndarray:
    """Centres (side^2, 2) of side x side cells of a pixel, the lowest row first."""
    cells = (np.arange(side) + 0.5) / side
    return np.stack([np.tile(cells, side), np.repeat(cells, side)], axis=1)


def rook_places(side: int) -> np.ndarray:
    """Places (side^2, 2) in side x side cells of a pixel, of which no two share a column or row of side^2 ones.

    Equal in all pixels and frames, so that edges neither step nor flicker. Within a cell of row j, the column is that
    of rank j in van der Corput's order, and so for rows.
    """
    order = np.argsort(np.argsort([_radical_inverse(number) for number in range(side)]))
    j, i = np.divmod(np.arange(side**2), side)
    return (np.stack([side * i + order[j], side * j + order[i]], axis=1) + 0.5) / side**2


class RayPattern(NamedTuple):
    """Rays of a pixel by their number along its side: their places, and the least footprints along it."""

    places: Callable[[int], np.ndarray]
    footprints: int


# Of pixels that are refined, and of pictures with equally many in every pixel.
GRID, EVEN = RayPattern(grid_places, 1), RayPattern(rook_places, EVEN_FOOTPRINT)


def _radical_inverse(number: int) -> float:
    value, digit = 0.0, 0.5
    while number:
        value += digit * (number & 1)
        number, digit = number >> 1, digit / 2.0
    return value


def box_splat(places: np.ndarray) -> Splat:
    """Splat of rays that have a plain mean alone."""
    return Splat(places, np.ones((1, len(places))), np.array([float(len(places))]))


def splat_of(pixel_filter: PixelFilter, places: np.ndarray) -> Splat:
    """Splat of a filter. All that is spread to a pixel around is exactly its share, however few the rays."""
    radius, shares = pixel_filter.radius, pixel_filter.shares()
    apart = np.arange(-radius, radius + 1)
    # A pixel `apart` from that of the rays sees them at this distance from its own centre.
    x, y = (pixel_filter.at(places[:, axis] - 0.5 - apart[:, None]) for axis in range(2))
    weights = (y[:, None, :] * x[None, :, :]).reshape(-1, len(places))
    weights[weights.sum(axis=1) <= 0.0] = 1.0  # no ray is where the filter is
    total = weights.sum(axis=1) / np.outer(shares, shares).ravel()
    mean = box_splat(places)
    return Splat(places, np.concatenate([weights, mean.weights]), np.concatenate([total, mean.total]))
