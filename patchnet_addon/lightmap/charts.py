# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture charts, one for every triangle.

Each triangle becomes a right triangle, its longest edge the hypotenuse, in a rectangle of 2^a x 2^b texels about as
large as its legs are in texels; `packing` places the rectangles. Triangles of about one texel get a single texel.
Crowded triangles get fewer paths (`sample_sharing.py`).

Every texel whose centre is in a triangle's half belongs to that triangle only, and the lines between the halves avoid
texel centres, so that rounding cannot change the owner of a texel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..runtime.errors import SettingError
from ..runtime.progress import Progress, Steps
from ..surface.mesh import MeshSource
from .packing import FIRST, SECOND, SINGLE, packed, texel_count
from .sample_sharing import crowding_of

MAX_PAGE_SIDE = 4096
_MAX_SHARES = 6  # halvings of the paths
# Cost of reading the scene for a further page, in paths: per triangle, and per call.
PATHS_PER_TRIANGLE, PATHS_PER_CALL = 2, 100_000
# In thinner rectangles the hypotenuse is so close to texel centres that rounding could change their owner.
_MAX_LOG_ASPECT = 4
# A single texel's triangle, in texels: its centroid is the texel's centre.
_SINGLE_CORNERS = np.array([[0.1, 0.25], [0.9, 0.25], [0.5, 1.0]])


@dataclass(frozen=True, eq=False)
class Charts:
    """Charts of T triangles on P square pages of `page_side` texels, and the number of paths of each page.

    page, x, y: (T,) int32, lower left texel of the triangle's rectangle. log_width, log_height: (T,) int8. kind: (T,)
    int8, FIRST has its right angle at the rectangle's lower left, SECOND at its upper right, SINGLE is one texel.
    origin: (T,) int8, the corner at the right angle. along: (T,) int8, the corner at the end of the leg along x.
    page_samples: (P,) int32, paths per texel. page_size: (P, 2) int32, width and height of the used part of each page.
    group: (T,) int32, equal for triangles that share paths, None without sharing. texel_world: side of the smallest
    texels. growth: ratio of texel sizes to the requested ones.
    """

    texel_world: float
    growth: float
    page_side: int
    page: np.ndarray
    x: np.ndarray
    y: np.ndarray
    log_width: np.ndarray
    log_height: np.ndarray
    kind: np.ndarray
    origin: np.ndarray
    along: np.ndarray
    page_samples: np.ndarray
    page_size: np.ndarray
    group: np.ndarray | None = None

    @property
    def page_count(self) -> int:
        """Number of pages."""
        return len(self.page_samples)

    @property
    def texel_count(self) -> int:
        """Texels on all pages, used or not."""
        return self.page_count * self.page_side**2

    @cached_property
    def legs(self) -> np.ndarray:
        """Lengths (T, 2) float32, in texels, of the legs of all triangles.

        The diagonal texels of a square belong to the first of its two triangles. Two for a single texel, so that its
        triangle owns it.
        """
        sides = np.stack([self.log_width, self.log_height], axis=-1)
        shift = np.where(sides[:, 0] == sides[:, 1], np.where(self.kind == FIRST, 0.5, -0.5), 0.0)
        legs = np.exp2(sides.astype(np.float32)) + shift[:, None].astype(np.float32)
        legs[self.kind == SINGLE] = 2.0
        return legs

    def corner_texels(self, triangles: np.ndarray) -> np.ndarray:
        """Positions (n, 3, 2) float64, in texels on their page, of the corners of triangles (n,)."""
        n = np.arange(len(triangles))
        kind, origin, along = (array[triangles] for array in (self.kind, self.origin, self.along))
        low = np.stack([self.x[triangles], self.y[triangles]], axis=-1).astype(np.float64)
        size = np.exp2(np.stack([self.log_width[triangles], self.log_height[triangles]], axis=-1).astype(np.float64))
        start = np.where((kind == SECOND)[:, None], low + size, low)
        legs = self.legs[triangles].astype(np.float64) * np.where(kind == SECOND, -1.0, 1.0)[:, None]
        corners = np.repeat(start[:, None], 3, axis=1)  # (n, 3, 2)
        corners[n, along, 0] += legs[:, 0]
        corners[n, 3 - origin - along, 1] += legs[:, 1]
        single = kind == SINGLE
        corners[single] = low[single][:, None] + _SINGLE_CORNERS
        return corners


def layout_charts(
    source: MeshSource,
    texel_world: float | np.ndarray,
    *,
    samples: int = 1,
    max_texels: int = 1 << 25,
    page_side: int = 1024,
) -> Steps[Charts]:
    """Charts for all triangles of `source`, with texels of about the side `texel_world`, one for all or (T,).

    Texels grow until the pages hold at most about `max_texels`, but a triangle has at least one. samples: paths per
    texel; crowded triangles get 1/2, 1/4, ... of them, at least 1. page_side: size of pages, larger if the largest
    triangle needs it (at most 4096), or smaller. Raises SettingError for texel sizes that are not positive.
    """
    wanted, origin, along, sides, growth = yield from _rectangles(source, texel_world, max_texels)
    shares, neighbours = np.zeros(source.triangle_count, np.uint8), None
    if samples > 1:
        excess, group = yield from crowding_of(source, wanted * np.float32(growth), _own_texels(sides))
        shares = _shares(excess, sides, samples)
        neighbours = group if shares.any() else None
    places, page_shares = packed(sides, shares, neighbours, page_side)
    return Charts(
        texel_world=float(wanted.min(initial=np.inf)) * growth,
        growth=growth,
        log_width=sides[:, 0],
        log_height=sides[:, 1],
        origin=origin,
        along=along,
        page_samples=np.maximum(samples >> page_shares, 1).astype(np.int32),
        group=neighbours,
        **places,
    )


def texels_wanted(source: MeshSource, texel_world: float | np.ndarray, max_texels: int = 1 << 25) -> Steps[int]:
    """Total number of texels of `layout_charts`, without computing the layout."""
    _, _, _, sides, _ = yield from _rectangles(source, texel_world, max_texels)
    return int(_own_texels(sides).sum())


def _rectangles(
    source: MeshSource, texel_world: float | np.ndarray, max_texels: int
) -> Steps[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]]:
    """Requested texel sides (T,), corners `origin` and `along` (T,), log2 of rectangles (T, 2), growth."""
    wanted = np.broadcast_to(np.asarray(texel_world, np.float32), source.triangle_count)
    if not (np.isfinite(wanted).all() and (wanted > 0).all()):
        raise SettingError(f"Texel size {wanted.min()} must be a positive length")
    origin = np.empty(source.triangle_count, np.int8)
    along = np.empty(source.triangle_count, np.int8)
    logs = np.empty((source.triangle_count, 2), np.float32)  # of the legs, longer first, in texels
    for batch in source.batches():
        part = slice(batch.first_triangle, batch.first_triangle + len(batch))
        origin[part], along[part], logs[part] = _legs(batch.corners_world)
        yield Progress(part.stop, source.triangle_count, "Laying out charts")
    logs -= np.log2(wanted)[:, None]
    limit, growth = int(np.log2(MAX_PAGE_SIDE)), 1.0
    sides = _chart_sides(logs, growth, limit)
    while texel_count(sides) > max_texels and sides.any():
        growth *= 2.0**0.25
        sides = _chart_sides(logs, growth, limit)
    return wanted, origin, along, sides, growth


def _own_texels(sides: np.ndarray) -> np.ndarray:
    """(T,) float64 texels of each triangle: half of its rectangle, or one."""
    return np.maximum(np.exp2(sides.sum(axis=1, dtype=np.int32) - 1.0), 1.0)


def _shares(excess: np.ndarray, sides: np.ndarray, samples: int) -> np.ndarray:
    """(T,) uint8 number of times that each triangle's paths are halved.

    A class whose own pages would save fewer paths than reading the scene again costs is merged with the previous one.
    """
    most = min(_MAX_SHARES, int(np.log2(samples)))
    shares = np.clip(np.floor(np.log2(excess) + 1e-6), 0, most).astype(np.uint8)
    texels = np.bincount(shares, _own_texels(sides), minlength=most + 1)
    for share in np.flatnonzero(texels)[:0:-1].tolist():
        lower = int(np.flatnonzero(texels[:share])[-1])
        saved = texels[share] * samples * (2.0**-lower - 2.0**-share)
        if saved < PATHS_PER_TRIANGLE * len(excess) + PATHS_PER_CALL:
            shares[shares == share] = lower
            texels[lower] += texels[share]
    return shares


def _legs(corners_world: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corner opposite to the longest edge, corner at the end of the longer leg, log2 of both legs (T, 2)."""
    edges = np.roll(corners_world, -1, axis=1) - corners_world  # (T, 3, 3), edge i from corner i to i + 1
    lengths = np.sqrt((edges * edges).sum(axis=-1))
    longest = lengths.argmax(axis=1)
    origin = (longest + 2) % 3
    n = np.arange(len(lengths))
    forward = lengths[n, origin]  # to corner origin + 1
    backward = lengths[n, (origin + 2) % 3]  # from corner origin + 2
    along = np.where(forward >= backward, origin + 1, origin + 2) % 3
    legs = np.stack([np.maximum(forward, backward), np.minimum(forward, backward)], axis=-1)
    return origin, along, np.log2(np.maximum(legs, 1e-30))


def _chart_sides(logs: np.ndarray, growth: float, limit: int) -> np.ndarray:
    """log2 (T, 2) int8 of rectangles' sides for legs of log2 lengths (T, 2) in texels after growth; (0, 0) is a single
    texel.
    """
    sides = np.clip(np.rint(logs - np.float32(np.log2(growth))), 0, limit).astype(np.int8)
    sides[:, 1] = np.maximum(sides[:, 1], sides[:, 0] - _MAX_LOG_ASPECT)
    sides[(sides[:, 0] <= 1) & (sides[:, 1] == 0)] = 0
    return sides
