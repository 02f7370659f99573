# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that a camera sees: a picture of their numbers.

Triangles come batch by batch and are drawn into a depth buffer, by edge functions in homogeneous coordinates (Olano and
Greer, Triangle Scan Conversion using 2D Homogeneous Coordinates, 1997), so that those that reach behind the camera need
no clipping.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device, kernel
from .camera import FORWARD, PERSPECTIVE, POSITION, RIGHT, UP, Camera


class SeenTriangles(NamedTuple):
    """Picture of a camera, row 0 at the bottom.

    triangle: (H, W) int64, the nearest one in each pixel's centre, -1 for none. depth: (H, W) float64 along the
    camera's axis, infinite where there is none.
    """

    triangle: np.ndarray
    depth: np.ndarray


class _Lens(NamedTuple):
    """Camera for the kernel: pose (4, 3) is position, right / half_x, up / half_y, forward; shift, clip: (2,)."""

    pose: np.ndarray
    shift: np.ndarray
    clip: np.ndarray
    perspective: bool


class _Corner(NamedTuple):
    """Corner of a triangle in a camera's frame: a picture point is (across, up) / w; depth: axial distance."""

    across: float
    up: float
    w: float
    depth: float


class _Box(NamedTuple):
    """First and last column and row."""

    left: int
    right: int
    low: int
    high: int


class Sight:
    """Depth buffer of a camera, filled by `add`."""

    def __init__(self, camera: Camera) -> None:
        """Begin with nothing seen."""
        right, up = np.asarray(camera.right) / camera.half_x, np.asarray(camera.up) / camera.half_y
        self._lens = _Lens(
            np.array((camera.position_world, right, up, camera.forward), np.float64),
            np.array((camera.shift_x, camera.shift_y), np.float64),
            np.array((camera.clip_start, camera.clip_end), np.float64),
            camera.kind == PERSPECTIVE,
        )
        shape = camera.height_px, camera.width_px
        self.seen = SeenTriangles(np.full(shape, -1, np.int64), np.full(shape, np.inf))

    def add(self, corners_world: np.ndarray, shown: np.ndarray, first_triangle: int) -> None:
        """Draw triangles (N, 3, 3) float64 where `shown` (N,) bool, whose numbers count from `first_triangle`.

        Of two that are as near the one that came first stays.
        """
        _draw(self._lens, corners_world, shown, first_triangle, self.seen)


@kernel
def _draw(lens: _Lens, corners_world: np.ndarray, shown: np.ndarray, first_triangle: int, seen: SeenTriangles) -> None:
    height, width = seen.depth.shape
    for t in range(len(corners_world)):
        if shown[t]:
            own = corners_world[t]
            corners = _place(lens, own[0]), _place(lens, own[1]), _place(lens, own[2])
            _draw_one(first_triangle + t, corners, _bounds(corners, lens.clip, width, height), lens.clip, seen)


@device
def _place(lens, corner_world):
    """Corner of a triangle in the frame of the camera."""
    pose = lens.pose
    across = up = depth = 0.0
    for axis in range(3):
        offset = corner_world[axis] - pose[POSITION, axis]
        across += offset * pose[RIGHT, axis]
        up += offset * pose[UP, axis]
        depth += offset * pose[FORWARD, axis]
    w = depth if lens.perspective else 1.0
    return _Corner(across - lens.shift[0] * w, up - lens.shift[1] * w, w, depth)


@device
def _bounds(corners, clip, width, height):
    """Box of the columns and rows whose centres may be in a triangle."""
    a, b, c = corners
    if max(a.depth, b.depth, c.depth) < clip[0] or min(a.depth, b.depth, c.depth) > clip[1]:
        return _Box(0, -1, 0, -1)
    if min(a.w, b.w, c.w) <= 0.0:  # reaches behind the camera: anywhere
        return _Box(0, width - 1, 0, height - 1)
    left, right = _span((a.across / a.w, b.across / b.w, c.across / c.w), width)
    low, high = _span((a.up / a.w, b.up / b.w, c.up / c.w), height)
    return _Box(left, right, low, high)


@device
def _span(points, size):
    """First and last of `size` columns, or rows, whose centres may be between points of a picture."""
    low, high = np.inf, -np.inf
    for point in points:
        place = ((point + 1.0) * size - 1.0) / 2.0
        low, high = min(low, place), max(high, place)
    if not (low <= size - 1 and high >= 0.0):
        return 0, -1
    return int(np.ceil(max(low - 1e-9, 0.0))), int(np.floor(min(high + 1e-9, size - 1.0)))


@device
def _draw_one(number, corners, box, clip, seen):
    """Draw a triangle where its depth is the least so far.

    Edge functions are linear in the picture: each is that of the edge opposite to a corner, as a plane through the eye.
    """
    height, width = seen.depth.shape
    one, two, three = corners
    for row in range(box.low, box.high + 1):
        y = (2.0 * row + 1.0) / height - 1.0
        for column in range(box.left, box.right + 1):
            x = (2.0 * column + 1.0) / width - 1.0
            a = _edge(two, three, x, y)
            b = _edge(three, one, x, y)
            d = _edge(one, two, x, y)
            total = a + b + d
            if total == 0.0 or a / total < 0.0 or b / total < 0.0 or d / total < 0.0:
                continue
            depth = (a * one.depth + b * two.depth + d * three.depth) / total
            if clip[0] <= depth <= clip[1] and depth < seen.depth[row, column]:
                seen.depth[row, column] = depth
                seen.triangle[row, column] = number


@device
def _edge(a, b, x, y):
    """Edge function of two corners at a picture point."""
    return (a.up * b.w - a.w * b.up) * x + (a.w * b.across - a.across * b.w) * y + a.across * b.up - a.up * b.across
