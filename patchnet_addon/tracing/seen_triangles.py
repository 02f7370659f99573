# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that cameras see, before there are voxels: a picture of triangle numbers each.

Triangles come batch by batch and are drawn into depth buffers, by edge functions in homogeneous coordinates (Olano and
Greer, Triangle Scan Conversion using 2D Homogeneous Coordinates, 1997), so that those that reach behind a camera need
no clipping.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .camera import FORWARD, PERSPECTIVE, POSITION, RIGHT, UP, Camera

WIDTH_PX, HEIGHT_PX = 96, 72  # of pictures that only have to tell what is in view


class SeenTriangles(NamedTuple):
    """Pictures of C cameras, H x W pixels each, row 0 at the bottom.

    triangle: (C, H, W) int64, the nearest one in each pixel's centre, -1 for none. depth: (C, H, W) float64 along the
    camera's axis, infinite where there is none.
    """

    triangle: np.ndarray
    depth: np.ndarray


class _Lenses(NamedTuple):
    """Cameras for the kernel: pose (C, 4, 3) is position, right / half_x, up / half_y, forward; clip: (C, 2)."""

    pose: np.ndarray
    shift: np.ndarray
    clip: np.ndarray
    perspective: np.ndarray


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
    """Depth buffers of cameras, filled by `add`."""

    def __init__(self, cameras: Sequence[Camera], size_px: tuple[int, int] = (WIDTH_PX, HEIGHT_PX)) -> None:
        """Begin with nothing seen, in pictures of a width and height."""
        self.cameras = tuple(cameras)
        count = len(cameras)
        poses = [
            (c.position_world, np.asarray(c.right) / c.half_x, np.asarray(c.up) / c.half_y, c.forward) for c in cameras
        ]
        self._lenses = _Lenses(
            np.array(poses, np.float64).reshape(count, 4, 3),
            np.array([(c.shift_x, c.shift_y) for c in cameras], np.float64).reshape(count, 2),
            np.array([(c.clip_start, c.clip_end) for c in cameras], np.float64).reshape(count, 2),
            np.array([c.kind == PERSPECTIVE for c in cameras], bool),
        )
        shape = count, size_px[1], size_px[0]
        self.seen = SeenTriangles(np.full(shape, -1, np.int64), np.full(shape, np.inf))

    def add(self, corners_world: np.ndarray, shown: np.ndarray, first_triangle: int) -> None:
        """Draw triangles (N, 3, 3) float64 where `shown` (N,) bool, whose numbers count from `first_triangle`.

        Of two that are as near the one that came first stays.
        """
        run_parts(_draw, len(self._lenses.pose), self._lenses, corners_world, shown, first_triangle, self.seen)

    def places(self, camera: int, pixels: np.ndarray) -> np.ndarray:
        """Places (N, 3) float64 in the world that pixels (N,) of a camera see, by indices row * W + column."""
        pose, shift = self._lenses.pose[camera], self._lenses.shift[camera]
        height, width = self.seen.depth.shape[1:]
        row, column = np.divmod(pixels, width)
        x = (2.0 * column + 1.0) / width - 1.0 + shift[0]
        y = (2.0 * row + 1.0) / height - 1.0 + shift[1]
        depth = self.seen.depth[camera].ravel()[pixels]
        right, up = (pose[axis] / (pose[axis] @ pose[axis]) for axis in (RIGHT, UP))  # times half the extents
        spread = depth if self._lenses.perspective[camera] else np.ones_like(depth)
        places: np.ndarray = pose[POSITION] + depth[:, None] * pose[FORWARD] + (x * spread)[:, None] * right
        return places + (y * spread)[:, None] * up


@kernel
def _draw(
    first: int, last: int, lenses: _Lenses, corners_world: np.ndarray, shown: np.ndarray, first_triangle: int,
    seen: SeenTriangles,
) -> None:  # fmt: skip
    _, height, width = seen.depth.shape
    for c in range(first, last):
        for t in range(len(corners_world)):
            if shown[t]:
                own = corners_world[t]
                corners = _place(lenses, c, own[0]), _place(lenses, c, own[1]), _place(lenses, c, own[2])
                box = _bounds(corners, lenses.clip[c], width, height)
                _draw_one(c, first_triangle + t, corners, box, lenses.clip[c], seen)


@device
def _place(lenses, c, corner_world):
    """Corner of a triangle in the frame of a camera."""
    pose = lenses.pose[c]
    across = up = depth = 0.0
    for axis in range(3):
        offset = corner_world[axis] - pose[POSITION, axis]
        across += offset * pose[RIGHT, axis]
        up += offset * pose[UP, axis]
        depth += offset * pose[FORWARD, axis]
    w = depth if lenses.perspective[c] else 1.0
    return _Corner(across - lenses.shift[c, 0] * w, up - lenses.shift[c, 1] * w, w, depth)


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
def _draw_one(c, number, corners, box, clip, seen):
    """Draw a triangle where its depth is the least so far.

    Edge functions are linear in the picture: each is that of the edge opposite to a corner, as a plane through the eye.
    """
    _, height, width = seen.depth.shape
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
            if clip[0] <= depth <= clip[1] and depth < seen.depth[c, row, column]:
                seen.depth[c, row, column] = depth
                seen.triangle[c, row, column] = number


@device
def _edge(a, b, x, y):
    """Edge function of two corners at a picture point."""
    return (a.up * b.w - a.w * b.up) * x + (a.w * b.across - a.across * b.w) * y + a.across * b.up - a.up * b.across
