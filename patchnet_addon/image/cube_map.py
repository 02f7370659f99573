# SPDX-License-Identifier: GPL-3.0-or-later
"""Cube map: light by direction, on the six faces of a cube around the eye."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..tracing.camera import ORTHOGRAPHIC, Camera

# Right, up and forward of each face: +x, -x, +y, -y, +z, -z.
FACES = np.array(
    [
        [[0, -1, 0], [0, 0, 1], [1, 0, 0]],
        [[0, 1, 0], [0, 0, 1], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, -1]],
    ],
    np.float64,
)


@dataclass(frozen=True, eq=False)
class CubeMap:
    """Light of six faces, (6, S, S, 3) float16, row 0 at the bottom; axes of the faces are those of FACES."""

    faces: np.ndarray

    def look(self, directions: np.ndarray) -> np.ndarray:
        """Light (N, 3) float32 of directions (N, 3), of any length, between the nearest four texels of a face."""
        axis = np.abs(directions).argmax(axis=1)
        face = 2 * axis + (directions[np.arange(len(axis)), axis] < 0.0)
        seen = np.einsum("nij,nj->ni", FACES[face], directions)
        side = self.faces.shape[1]
        places = ((seen[:, :2] / seen[:, 2:] + 1.0) * (side / 2.0) - 0.5).clip(0.0, side - 1.0)
        low = np.minimum(places.astype(np.int64), max(side - 2, 0))
        high = np.minimum(low + 1, side - 1)
        share = (places - low).astype(np.float32)
        (left, bottom), (right, top) = low.T, high.T
        lower = self._between(face, bottom, left, right, share[:, :1])
        upper = self._between(face, top, left, right, share[:, :1])
        result: np.ndarray = lower + share[:, 1:] * (upper - lower)
        return result

    def _between(
        self, face: np.ndarray, row: np.ndarray, left: np.ndarray, right: np.ndarray, share: np.ndarray
    ) -> np.ndarray:
        first, second = (self.faces[face, row, column].astype(np.float32) for column in (left, right))
        between: np.ndarray = first + share * (second - first)
        return between


def face_camera(face: int, side_px: int) -> Camera:
    """Camera that sees one face of a cube map."""
    right, up, forward = FACES[face]
    return Camera(np.zeros(3), right, up, forward, 1.0, 1.0, side_px, side_px, name=f"Face {face}")


def view_corners(camera: Camera) -> np.ndarray:
    """Viewing directions (4, 3) float64 at the corners of a camera's picture: lower left, right, upper right, left.

    Directions between are interpolated linearly. An orthographic camera has a single direction.
    """
    forward = np.asarray(camera.forward, np.float64)
    if camera.kind == ORTHOGRAPHIC:
        return np.repeat(forward[None], 4, axis=0)
    x = camera.half_x * (np.array([-1.0, 1.0, 1.0, -1.0]) + camera.shift_x)
    y = camera.half_y * (np.array([-1.0, -1.0, 1.0, 1.0]) + camera.shift_y)
    return forward + x[:, None] * np.asarray(camera.right) + y[:, None] * np.asarray(camera.up)


def pixel_directions(camera: Camera) -> np.ndarray:
    """Directions (P, 3) float64 of the centres of a camera's pixels, not normalized."""
    lower_left, lower_right, _, upper_left = view_corners(camera)
    x = (np.arange(camera.width_px) + 0.5) / camera.width_px
    y = (np.arange(camera.height_px) + 0.5) / camera.height_px
    across, along = (lower_right - lower_left)[None, None], (upper_left - lower_left)[None, None]
    return (lower_left + x[None, :, None] * across + y[:, None, None] * along).reshape(-1, 3)
