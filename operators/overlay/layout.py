# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectangles in a region, in pixels from its lower left corner, as floats; pure arithmetic, no Blender."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...patchnet_addon.tracing.camera import Camera


class Rect(NamedTuple):
    """Axis-aligned rectangle; empty if its right or top lies before its left or bottom."""

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
        """Return whether it has no area."""
        return self.width <= 0 or self.height <= 0

    def meet(self, other: Rect) -> Rect:
        """Intersection of both; empty if they have nothing in common."""
        low = max(self.left, other.left), max(self.bottom, other.bottom)
        return Rect(*low, min(self.right, other.right), min(self.top, other.top))

    def part(self, inner: Rect) -> Rect:
        """Part of this rectangle; `inner` is in fractions [0, 1] of its sides."""
        x, y = (self.left + inner.left * self.width, self.bottom + inner.bottom * self.height)
        return Rect(x, y, x + inner.width * self.width, y + inner.height * self.height)


def frame_rect(camera: Camera, window_matrix: Sequence[Sequence[float]], width: int, height: int) -> Rect | None:
    """Rectangle of `camera`'s picture in a 3D viewport of width x height pixels that looks through that camera.

    window_matrix: 4 x 4, from camera space to the window, as in RegionView3D, with zoom, offset and shift.
    The picture has the camera's own aspect, not that of the present render size. None if it cannot be seen.
    """
    corners = [
        [(side_x + camera.shift_x) * camera.half_x, (side_y + camera.shift_y) * camera.half_y, -1.0, 1.0]
        for side_x in (-1.0, 1.0)
        for side_y in (-1.0, 1.0)
    ]
    clip = np.array(corners) @ np.array(window_matrix, np.float64).T  # (4, 4)
    if not (np.isfinite(clip).all() and (clip[:, 3] > 0).all()):
        return None
    points = (clip[:, :2] / clip[:, 3:] + 1.0) / 2.0 * (width, height)
    rect = Rect(*points.min(axis=0).tolist(), *points.max(axis=0).tolist())
    return None if rect.empty else rect


def image_rect(low: Sequence[float], high: Sequence[float], width: int, height: int) -> Rect | None:
    """Rectangle of an image in an Image Editor of width x height pixels.

    low, high: image coordinates, [0, 1] inside the image, at the region's lower left and upper right corner.
    """
    span_x, span_y = high[0] - low[0], high[1] - low[1]
    if span_x <= 0 or span_y <= 0:
        return None
    x, y = -low[0] / span_x * width, -low[1] / span_y * height
    return Rect(x, y, x + width / span_x, y + height / span_y)


def pixel_at(rect: Rect, size_px: tuple[int, int], x: float, y: float) -> tuple[int, int] | None:
    """Column and row, from the lower left, of the pixel under a point; None outside the picture."""
    if rect.empty:
        return None
    share_x, share_y = (x - rect.left) / rect.width, (y - rect.bottom) / rect.height
    if not (0.0 <= share_x < 1.0 and 0.0 <= share_y < 1.0):
        return None
    return int(share_x * size_px[0]), int(share_y * size_px[1])


def beside(point: tuple[float, float], size: tuple[float, float], gap: float, within: Rect) -> tuple[float, float]:
    """Lower left corner of a box of some size to the lower right of a point, or on another side if there is no room."""
    x, y = point[0] + gap, point[1] - gap - size[1]
    if x + size[0] > within.right:
        x = point[0] - gap - size[0]
    if y < within.bottom:
        y = point[1] + gap
    return max(x, within.left), min(max(y, within.bottom), max(within.top - size[1], within.bottom))
