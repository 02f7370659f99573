# SPDX-License-Identifier: GPL-3.0-or-later
"""A texture chart for every triangle, packed without a search.

Each triangle becomes a right triangle, its longest edge the hypotenuse, in a rectangle of 2^a x 2^b texels about as
large as its legs are in texels. Two triangles share a rectangle, rectangles stack to squares of 2^a x 2^a, and squares,
the largest first, follow each other along a Morton curve: a square's place is the number of texels before it. Triangles
of about one texel get one texel of their own.

Every texel whose centre lies in a triangle's half belongs to that triangle alone, and the lines between the halves stay
clear of texel centres, so that no rounding can change who owns a texel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SettingError
from ..octree.mesh import MeshSource
from ..progress import Progress, Steps

FIRST, SECOND, SINGLE = range(3)
MAX_PAGE_SIDE = 4096
# Thinner rectangles would bring the hypotenuse so close to texel centres that rounding could change their owner.
_MAX_LOG_ASPECT = 4
# A single texel's triangle, in texels: its centroid is the texel's centre.
_SINGLE_CORNERS = np.array([[0.1, 0.25], [0.9, 0.25], [0.5, 1.0]])


@dataclass(frozen=True, eq=False)
class Charts:
    """Where each of T triangles lies on square pages of `page_side` texels.

    page, x, y: (T,) int32, lower left texel of the triangle's rectangle. log_width, log_height: (T,) int8.
    kind: (T,) int8, FIRST has its right angle at the rectangle's lower left, SECOND at its upper right, SINGLE is one
    texel.
    origin: (T,) int8, the corner at the right angle. along: (T,) int8, the corner at the end of the leg along x.
    """

    texel_world: float
    page_side: int
    page_count: int
    page: np.ndarray
    x: np.ndarray
    y: np.ndarray
    log_width: np.ndarray
    log_height: np.ndarray
    kind: np.ndarray
    origin: np.ndarray
    along: np.ndarray

    @property
    def texel_count(self) -> int:
        """Texels on all pages, used or not."""
        return self.page_count * self.page_side**2

    def legs(self, triangles: np.ndarray) -> np.ndarray:
        """Lengths (n, 2) float64, in texels, of the legs of triangles (n,) that are not SINGLE.

        The diagonal texels of a square belong to the first of its two triangles.
        """
        sides = np.stack([self.log_width[triangles], self.log_height[triangles]], axis=-1)
        square = sides[:, 0] == sides[:, 1]
        shift = np.where(square, np.where(self.kind[triangles] == FIRST, 0.5, -0.5), 0.0)
        return np.exp2(sides.astype(np.float64)) + shift[:, None]

    def corner_texels(self, triangles: np.ndarray) -> np.ndarray:
        """Positions (n, 3, 2) float64, in texels on their page, of the corners of triangles (n,)."""
        n = np.arange(len(triangles))
        kind, origin, along = (array[triangles] for array in (self.kind, self.origin, self.along))
        low = np.stack([self.x[triangles], self.y[triangles]], axis=-1).astype(np.float64)
        size = np.exp2(np.stack([self.log_width[triangles], self.log_height[triangles]], axis=-1).astype(np.float64))
        start = np.where((kind == SECOND)[:, None], low + size, low)
        legs = self.legs(triangles) * np.where(kind == SECOND, -1.0, 1.0)[:, None]
        corners = np.repeat(start[:, None], 3, axis=1)  # (n, 3, 2)
        corners[n, along, 0] += legs[:, 0]
        corners[n, 3 - origin - along, 1] += legs[:, 1]
        single = kind == SINGLE
        corners[single] = low[single][:, None] + _SINGLE_CORNERS
        return corners


def layout_charts(
    source: MeshSource, texel_world: float, *, max_texels: int = 1 << 25, page_side: int = 1024
) -> Steps[Charts]:
    """Charts for all triangles of `source`, with texels of about the side `texel_world`.

    Texels grow as far as needed for the pages to hold at most about `max_texels`, but a triangle has at least one.
    page_side: pages are this large, or larger if the largest triangle asks for it (at most 4096), or smaller.
    """
    if not (np.isfinite(texel_world) and texel_world > 0):
        raise SettingError(f"Texel size {texel_world} must be a positive length")
    origin = np.empty(source.triangle_count, np.int8)
    along = np.empty(source.triangle_count, np.int8)
    logs = np.empty((source.triangle_count, 2), np.float32)  # of the legs, longer first, world units
    for batch in source.batches():
        part = slice(batch.first_triangle, batch.first_triangle + len(batch))
        origin[part], along[part], logs[part] = _legs(batch.corners_world)
        yield Progress(part.stop, source.triangle_count, "Laying out charts")
    limit = int(np.log2(MAX_PAGE_SIDE))
    sides = _chart_sides(logs, texel_world, limit)
    while _texels(sides) > max_texels and sides.any():
        texel_world *= 2.0**0.25
        sides = _chart_sides(logs, texel_world, limit)
    return _packed(sides, origin, along, texel_world, page_side)


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


def _chart_sides(logs: np.ndarray, texel_world: float, limit: int) -> np.ndarray:
    """log2 (T, 2) int8 of rectangles' sides for legs of log2 lengths (T, 2); (0, 0) is a single texel."""
    sides = np.clip(np.rint(logs - np.float32(np.log2(texel_world))), 0, limit).astype(np.int8)
    sides[:, 1] = np.maximum(sides[:, 1], sides[:, 0] - _MAX_LOG_ASPECT)
    sides[(sides[:, 0] <= 1) & (sides[:, 1] == 0)] = 0
    return sides


def _classes(sides: np.ndarray) -> np.ndarray:
    """(T,) uint8, ascending with falling width, then falling height; the last class is that of single texels."""
    return ((15 - sides[:, 0]) * 16 + (15 - sides[:, 1])).astype(np.uint8)


def _squares(width: int, height: int, count: int | np.ndarray) -> int | np.ndarray:
    """Squares that `count` triangles of a class fill."""
    return count if width == 0 else -(-count // (2 << (width - height)))


def _texels(sides: np.ndarray) -> int:
    counts = np.bincount(_classes(sides), minlength=256)
    total = 0
    for number in np.flatnonzero(counts):
        width, height = 15 - number // 16, 15 - number % 16
        total += int(_squares(width, height, int(counts[number]))) << (2 * width)
    return total


def _packed(sides: np.ndarray, origin: np.ndarray, along: np.ndarray, texel_world: float, page_side: int) -> Charts:
    """Place squares along the Morton curve, the largest first."""
    total = _texels(sides)
    least = int(np.ceil(np.log2(max(total, 1)) / 2))
    log_side = max(int(sides.max(initial=0)), min(int(np.log2(page_side)), least))
    classes = _classes(sides)
    order = np.argsort(classes, kind="stable")
    starts = np.flatnonzero(np.diff(classes[order], prepend=-1))
    ends = np.append(starts[1:], len(order))
    place = np.empty(len(order), np.int64)  # texels before the triangle's square
    stacked = np.zeros(len(order), np.int32)  # height in its square
    kind = np.full(len(order), SINGLE, np.int8)
    before = 0
    for start, end in zip(starts, ends, strict=True):
        members = order[start:end]
        width, height = (int(side) for side in sides[members[0]])
        number = np.arange(end - start)
        square = number if width == 0 else number // (2 << (width - height))
        place[members] = before + (square << (2 * width))
        if width > 0:
            kind[members] = number % 2
            stacked[members] = ((number // 2) % (1 << (width - height))) << height
        before += int(_squares(width, height, end - start)) << (2 * width)
    page, rest = place >> (2 * log_side), place & ((1 << (2 * log_side)) - 1)
    return Charts(
        texel_world=texel_world,
        page_side=1 << log_side,
        page_count=max(1, -(-total // (1 << (2 * log_side)))),
        page=page.astype(np.int32),
        x=_even_bits(rest).astype(np.int32),
        y=_even_bits(rest >> 1).astype(np.int32) + stacked,
        log_width=sides[:, 0],
        log_height=sides[:, 1],
        kind=kind,
        origin=origin,
        along=along,
    )


def _even_bits(values: np.ndarray) -> np.ndarray:
    """Bits 0, 2, 4, ... of up to 32, moved together."""
    values = values & 0x55555555
    for shift, mask in ((1, 0x33333333), (2, 0x0F0F0F0F), (4, 0x00FF00FF), (8, 0x0000FFFF)):
        values = (values | (values >> shift)) & mask
    return values
