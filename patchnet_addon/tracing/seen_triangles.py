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
from .camera import PERSPECTIVE, Camera

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
        right, up = pose[1] / (pose[1] @ pose[1]), pose[2] / (pose[2] @ pose[2])  # times half the extents
        spread = depth if self._lenses.perspective[camera] else np.ones_like(depth)
        places: np.ndarray = pose[0] + depth[:, None] * pose[3] + (x * spread)[:, None] * right
        return places + (y * spread)[:, None] * up


@kernel
def _draw(first, last, lenses, corners_world, shown, first_triangle, seen):
    corner = np.empty((3, 4))  # across and up in half extents, times w; w; axial distance
    box = np.empty(4, np.int64)
    _, height, width = seen.depth.shape
    for c in range(first, last):
        for t in range(len(corners_world)):
            if shown[t]:
                _place(lenses, c, corners_world, t, corner)
                if _bounds(corner, lenses.clip[c], width, height, box):
                    _draw_one(c, first_triangle + t, corner, box, lenses.clip[c], seen)


@device
def _place(lenses, c, corners_world, t, corner):
    """Corners of a triangle in the camera's frame: a picture point is (corner 0, corner 1) / corner 2."""
    pose = lenses.pose[c]
    for i in range(3):
        across = 0.0
        up = 0.0
        depth = 0.0
        for axis in range(3):
            offset = corners_world[t, i, axis] - pose[0, axis]
            across += offset * pose[1, axis]
            up += offset * pose[2, axis]
            depth += offset * pose[3, axis]
        w = depth if lenses.perspective[c] else 1.0
        corner[i, 0] = across - lenses.shift[c, 0] * w
        corner[i, 1] = up - lenses.shift[c, 1] * w
        corner[i, 2] = w
        corner[i, 3] = depth


@device
def _bounds(corner, clip, width, height, box):
    """Fill in first and last column and row whose centres may be in a triangle; return whether there are any."""
    nearest = min(corner[0, 3], corner[1, 3], corner[2, 3])
    farthest = max(corner[0, 3], corner[1, 3], corner[2, 3])
    if farthest < clip[0] or nearest > clip[1]:
        return False
    box[0], box[1], box[2], box[3] = 0, width - 1, 0, height - 1
    if min(corner[0, 2], corner[1, 2], corner[2, 2]) <= 0.0:  # reaches behind the camera: anywhere
        return True
    for axis in range(2):
        size = width if axis == 0 else height
        low = np.inf
        high = -np.inf
        for i in range(3):
            place = ((corner[i, axis] / corner[i, 2] + 1.0) * size - 1.0) / 2.0
            low = min(low, place)
            high = max(high, place)
        if not (low <= size - 1 and high >= 0.0):
            return False
        box[2 * axis] = np.int64(np.ceil(max(low - 1e-9, 0.0)))
        box[2 * axis + 1] = np.int64(np.floor(min(high + 1e-9, size - 1.0)))
    return box[0] <= box[1] and box[2] <= box[3]


@device
def _draw_one(c, number, corner, box, clip, seen):
    """Draw a triangle where its depth is the least so far.

    Edge functions are linear in the picture: each is that of the edge opposite to a corner, as a plane through the eye.
    """
    _, height, width = seen.depth.shape
    for row in range(box[2], box[3] + 1):
        y = (2.0 * row + 1.0) / height - 1.0
        for column in range(box[0], box[1] + 1):
            x = (2.0 * column + 1.0) / width - 1.0
            a = _edge(corner, 1, 2, x, y)
            b = _edge(corner, 2, 0, x, y)
            d = _edge(corner, 0, 1, x, y)
            total = a + b + d
            if total == 0.0 or a / total < 0.0 or b / total < 0.0 or d / total < 0.0:
                continue
            depth = (a * corner[0, 3] + b * corner[1, 3] + d * corner[2, 3]) / total
            if clip[0] <= depth <= clip[1] and depth < seen.depth[c, row, column]:
                seen.depth[c, row, column] = depth
                seen.triangle[c, row, column] = number


@device
def _edge(corner, i, j, x, y):
    """Edge function of the corners i and j at a picture point."""
    return (
        (corner[i, 1] * corner[j, 2] - corner[i, 2] * corner[j, 1]) * x
        + (corner[i, 2] * corner[j, 0] - corner[i, 0] * corner[j, 2]) * y
        + corner[i, 0] * corner[j, 1]
        - corner[i, 1] * corner[j, 0]
    )
