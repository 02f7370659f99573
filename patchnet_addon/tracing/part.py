# SPDX-License-Identifier: GPL-3.0-or-later
"""Part of a camera's picture as a camera of its own: border renders, and pictures that are made bit by bit."""

from __future__ import annotations

from dataclasses import replace

from ..runtime.errors import SettingError
from .camera import Camera


def camera_part(camera: Camera, left_px: int, bottom_px: int, width_px: int, height_px: int) -> Camera:
    """Camera whose pixels are those of `camera` from (left, bottom) on, with the same rays and the same sides.

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
