# SPDX-License-Identifier: GPL-3.0-or-later
"""Perspective and orthographic cameras, and their form for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..octree.grid import Grid
from ..runtime.errors import SettingError

PERSPECTIVE = "PERSP"
ORTHOGRAPHIC = "ORTHO"
POSITION, RIGHT, UP, FORWARD = range(4)  # rows of a pose
FRAMING_DIRECTION = np.array([0.62, -1.0, 0.48])  # from a scene to a camera: in front, to the right, above


@dataclass(frozen=True, eq=False)
class Camera:
    """Camera in world units.

    right, up, forward: (3,) float64, orthonormal; forward points into the picture.
    half_x, half_y: PERSP: tangents of the half angles; ORTHO: half extents in world units.
    shift_x, shift_y: offset of the picture's centre, in half extents.
    clip_start, clip_end: bounds of the visible distance along `forward`, to the accuracy of a voxel. Pixels are square:
    the pixel side follows from the height (methods 4.1b).
    """

    position_world: np.ndarray
    right: np.ndarray
    up: np.ndarray
    forward: np.ndarray
    half_x: float
    half_y: float
    width_px: int
    height_px: int
    kind: str = PERSPECTIVE
    shift_x: float = 0.0
    shift_y: float = 0.0
    name: str = "Camera"
    clip_start: float = 0.0
    clip_end: float = float("inf")

    def __post_init__(self) -> None:
        if self.kind not in (PERSPECTIVE, ORTHOGRAPHIC):
            raise SettingError(f"Camera {self.name!r} is of type {self.kind}: use a perspective or orthographic camera")
        if min(self.width_px, self.height_px) < 1:
            raise SettingError(f"Picture size {self.width_px} x {self.height_px} is empty: choose at least 1 x 1 pixel")
        if not (self.half_x > 0 and self.half_y > 0):
            raise SettingError(f"Camera {self.name!r} has no field of view: set its focal length or scale")

    @classmethod
    def look_at(
        cls,
        position_world: np.ndarray,
        target_world: np.ndarray,
        *,
        up_world: Sequence[float] = (0.0, 0.0, 1.0),
        fov: float = np.radians(50.0),
        size_px: tuple[int, int] = (130, 130),
        name: str = "Camera",
    ) -> Camera:
        """Perspective camera at a position (3,), looking at a target (3,); fov is the vertical angle in radians."""
        forward = np.asarray(target_world, np.float64) - position_world
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, up_world)
        if np.linalg.norm(right) < 1e-9:  # view direction parallel to up: any right vector fits
            right = np.cross(forward, np.roll(forward, 1) + [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        width, height = size_px
        half_y = float(np.tan(fov / 2))
        return cls(
            np.asarray(position_world, np.float64), right, np.cross(right, forward), forward,
            half_y * width / height, half_y, width, height, name=name,
        )  # fmt: skip

    @property
    def pixel_count(self) -> int:
        """Pixels of the picture."""
        return self.width_px * self.height_px

    def with_size(self, width_px: int, height_px: int) -> Camera:
        """Resize the view to another resolution of the same aspect ratio."""
        return replace(self, width_px=width_px, height_px=height_px)

    def pixel_side(self, z_world: np.ndarray) -> np.ndarray:
        """World side of a pixel at axial distance z (methods 4.1b)."""
        side = 2.0 * self.half_y / self.height_px
        return side * np.asarray(z_world) if self.kind == PERSPECTIVE else np.full_like(z_world, side, dtype=np.float64)


class CameraUnit(NamedTuple):
    """Camera in the octree's unit cube, for kernels.

    pose: (4, 3) float64 position, right * half_x, up * half_y, forward.
    shift_x, shift_y: offset of the picture's centre, in half extents.
    side_at_0, side_per_z: side of a pixel at axial distance z is side_at_0 + side_per_z * z (methods 4.1b).
    nearest, farthest: axial clipping distances.
    side_world: side of the cube.
    """

    pose: np.ndarray
    shift_x: float
    shift_y: float
    side_at_0: float
    side_per_z: float
    nearest: float
    farthest: float
    perspective: bool
    width_px: int
    height_px: int
    side_world: float

    def finer(self, factor: float) -> CameraUnit:
        """Shrink the footprint of rays to pixel / factor; the rays stay where they are."""
        return self._replace(side_at_0=self.side_at_0 / factor, side_per_z=self.side_per_z / factor)


def camera_in_unit_cube(camera: Camera, grid: Grid) -> CameraUnit:
    """Transform `camera` into the octree's cube [0, 1]^3."""
    perspective = camera.kind == PERSPECTIVE
    scale = 1.0 if perspective else 1.0 / grid.side_world
    pose = np.stack(
        [
            grid.to_unit(camera.position_world),
            np.asarray(camera.right) * camera.half_x * scale,
            np.asarray(camera.up) * camera.half_y * scale,
            np.asarray(camera.forward, np.float64),
        ]
    ).astype(np.float64)
    side = float(2.0 * camera.half_y * scale / camera.height_px)
    return CameraUnit(
        pose,
        shift_x=float(camera.shift_x),
        shift_y=float(camera.shift_y),
        side_at_0=0.0 if perspective else side,
        side_per_z=side if perspective else 0.0,
        nearest=float(camera.clip_start / grid.side_world),
        farthest=float(camera.clip_end / grid.side_world),
        perspective=perspective,
        width_px=int(camera.width_px),
        height_px=int(camera.height_px),
        side_world=float(grid.side_world),
    )


def camera_part(camera: Camera, left_px: int, bottom_px: int, width_px: int, height_px: int) -> Camera:
    """Camera for the pixels of `camera` from (left, bottom) on, with the same rays and pixel sides.

    Raises SettingError if the rectangle is empty or reaches beyond the picture.
    """
    right_px, top_px = left_px + width_px, bottom_px + height_px
    fits = 0 <= left_px < right_px <= camera.width_px and 0 <= bottom_px < top_px <= camera.height_px
    if not fits:
        raise SettingError(
            f"The render border, {width_px} x {height_px} pixels from ({left_px}, {bottom_px}), is not within a "
            f"picture of {camera.width_px} x {camera.height_px} pixels: draw it larger, or turn it off"
        )
    if (width_px, height_px) == (camera.width_px, camera.height_px):
        return camera
    half_x, shift_x = _side(camera.half_x, camera.shift_x, left_px, width_px, camera.width_px)
    half_y, shift_y = _side(camera.half_y, camera.shift_y, bottom_px, height_px, camera.height_px)
    return replace(
        camera,
        half_x=half_x,
        half_y=half_y,
        shift_x=shift_x,
        shift_y=shift_y,
        width_px=width_px,
        height_px=height_px,
    )


def _side(half: float, shift: float, start: int, count: int, whole: int) -> tuple[float, float]:
    """Half extent and shift of `count` of `whole` pixels from `start` on.

    A picture coordinate x of [-1, 1] is the ray half * (x + shift); in the part x = (2 start + count) / whole - 1 is 0.
    """
    centre = (2.0 * start + count) / whole - 1.0
    return half * count / whole, (shift + centre) * whole / count
