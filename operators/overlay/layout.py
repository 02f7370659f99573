# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectangles in a region, in pixels from its lower left corner, as floats; pure arithmetic, no Blender."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ...patchnet_addon.tracing.camera import Camera


class Rect(NamedTuple):
    """Rectangle with sides along the region's."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def width(self) -> float:
        """Width; negative for a rectangle that is empty."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Height; negative for a rectangle that is empty."""
        return self.top - self.bottom

    @property
    def empty(self) -> bool:
        """Return whether there is nothing in it."""
        return self.width <= 0 or self.height <= 0

    def meet(self, other: Rect) -> Rect:
        """Intersection of both; empty if they have nothing in common."""
        return Rect(
            max(self.left, other.left),
            max(self.bottom, other.bottom),
            min(self.right, other.right),
            min(self.top, other.top),
        )

    def part(self, inner: Rect) -> Rect:
        """Rectangle that `inner`, in shares of this one, [0, 1] along each side, takes of it."""
        return Rect(
            self.left + inner.left * self.width,
            self.bottom + inner.bottom * self.height,
            self.left + inner.right * self.width,
            self.bottom + inner.top * self.height,
        )


def frame_rect(camera: Camera, window_matrix: Sequence[Sequence[float]], width: int, height: int) -> Rect | None:
    """Rectangle of `camera`'s picture in a 3D viewport of width x height pixels that looks through that camera.

    window_matrix: 4 x 4, from camera space to the window, as a RegionView3D has it: zoom, offset and shift are in it.
    The picture has the camera's own aspect, whatever the scene's render size says now. None if it cannot be seen.
    """
    corners = [
        [(side_x + camera.shift_x) * camera.half_x, (side_y + camera.shift_y) * camera.half_y, -1.0, 1.0]
        for side_x in (-1.0, 1.0)
        for side_y in (-1.0, 1.0)
    ]
    clip = np.array(corners) @ np.array(window_matrix, np.float64).T  # (4, 4)
    if not (np.isfinite(clip).all() and (clip[:, 3] > 0).all()):
        return None
    x, y = ((clip[:, axis] / clip[:, 3] + 1.0) / 2.0 * side for axis, side in ((0, width), (1, height)))
    rect = Rect(float(x.min()), float(y.min()), float(x.max()), float(y.max()))
    return None if rect.empty else rect


def image_rect(low: Sequence[float], high: Sequence[float], width: int, height: int) -> Rect | None:
    """Rectangle of an image in an Image Editor of width x height pixels.

    `low` and `high` are the image coordinates, [0, 1] inside the image, at the region's lower left and upper right
    corner.
    """
    span_x, span_y = high[0] - low[0], high[1] - low[1]
    if span_x <= 0 or span_y <= 0:
        return None
    return Rect(
        -low[0] / span_x * width,
        -low[1] / span_y * height,
        (1.0 - low[0]) / span_x * width,
        (1.0 - low[1]) / span_y * height,
    )


def inset_rect(room: Rect, aspect: float, share: float, gap: float) -> Rect:
    """Rectangle of an aspect (width / height) in the lower right corner of a room, `share` of its sides at most.

    gap: between it and the room's sides.
    """
    width = min(share * room.width, share * room.height * aspect)
    right, bottom = room.right - gap, room.bottom + gap
    return Rect(right - width, bottom, right, bottom + width / aspect)


def pixel_at(rect: Rect, size_px: tuple[int, int], x: float, y: float) -> tuple[int, int] | None:
    """Column and row, from the lower left, of the pixel under a point; None outside the picture."""
    if rect.empty:
        return None
    share_x, share_y = (x - rect.left) / rect.width, (y - rect.bottom) / rect.height
    if not (0.0 <= share_x < 1.0 and 0.0 <= share_y < 1.0):
        return None
    return int(share_x * size_px[0]), int(share_y * size_px[1])


def wipe_at(rect: Rect, x: float) -> float:
    """Position of the wipe, [0, 1] along the picture's width, that puts its line at x."""
    return min(max((x - rect.left) / rect.width, 0.0), 1.0)


def sides_of_wipe(rect: Rect, wipe: float) -> tuple[Rect, Rect]:
    """Rectangles to the left and right of the wipe's line."""
    middle = rect.left + min(max(wipe, 0.0), 1.0) * rect.width
    return rect._replace(right=middle), rect._replace(left=middle)


def visible_rect(region: Rect, covers: Iterable[Rect]) -> Rect:
    """Rectangle of a region that bars along its sides leave free, all in one system of coordinates; bars overlap it.

    A bar that touches two sides covers the one along which it is longer.
    """
    seen = region
    for bar in covers:
        common = region.meet(bar)
        if common.empty:
            continue
        if common.width >= common.height:
            above = common.top - region.bottom > region.top - common.bottom
            seen = seen.meet(region._replace(top=common.bottom) if above else region._replace(bottom=common.top))
        else:
            right = common.right - region.left > region.right - common.left
            seen = seen.meet(region._replace(right=common.left) if right else region._replace(left=common.right))
    return seen


def beside(point: tuple[float, float], size: tuple[float, float], gap: float, within: Rect) -> tuple[float, float]:
    """Lower left corner of a box of some size to the lower right of a point, or on its other side where room ends."""
    x, y = point[0] + gap, point[1] - gap - size[1]
    if x + size[0] > within.right:
        x = point[0] - gap - size[0]
    if y < within.bottom:
        y = point[1] + gap
    return max(x, within.left), min(max(y, within.bottom), max(within.top - size[1], within.bottom))


def tick_values(maximum: float, count: int = 5) -> list[tuple[float, str]]:
    """Places on a legend's bar, [0, 1], with their numbers from 0 to the configured maximum."""
    shares = [index / (count - 1) for index in range(count)]
    return [(share, f"{maximum * share:.3g}") for share in shares]
