# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras of the render engine: the scene's with border and pixel aspect, and the one that a viewport looks through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.sampling.importance import PixelRect
from ...patchnet_addon.tracing.camera import ORTHOGRAPHIC, PERSPECTIVE, Camera, camera_part
from ...patchnet_addon.tracing.pixel_filter import PixelFilter
from ..scene.cameras import tracing_camera
from ..scene.pixel_filter import pixel_filter_of

_MARGIN = 1  # traced pixels around a render border, for priorities; beyond those, whose rays count in its pixels


class RenderView(NamedTuple):
    """View that a render traces.

    camera: of the view. picture, kept: rectangles of the whole picture and of the render's result in the view.
    pixel_filter: of the scene.
    """

    camera: Camera
    picture: PixelRect
    kept: PixelRect
    pixel_filter: PixelFilter


def render_view(scene: bpy.types.Scene, camera: bpy.types.Object | None, size_px: tuple[int, int]) -> RenderView:
    """View of an evaluated camera object at the render resolution.

    The result is the part of the picture within the render border. The view adds a margin within the picture, so that
    pixels at the border are ranked and filtered as in the whole picture. scene: evaluated. Raises SceneError without a
    camera and for panoramic ones, SettingError for an empty border.
    """
    if camera is None:
        raise SceneError(f"Scene '{scene.name}' has no active camera: add one, or make one active with Ctrl Numpad 0")
    whole = tracing_camera(camera, scene, size_px)
    render, pixel_filter = scene.render, pixel_filter_of(scene)
    if not render.use_border:
        return RenderView(whole, PixelRect(0, 0, *size_px), PixelRect(0, 0, *size_px), pixel_filter)
    left, right = (int(side * size_px[0]) for side in (render.border_min_x, render.border_max_x))  # as Blender rounds
    bottom, top = (int(side * size_px[1]) for side in (render.border_min_y, render.border_max_y))
    camera_part(whole, left, bottom, right - left, top - bottom)  # raises for an empty border
    margin = _MARGIN + pixel_filter.radius
    first_x, last_x = max(left - margin, 0), min(right + margin, size_px[0])
    first_y, last_y = max(bottom - margin, 0), min(top + margin, size_px[1])
    return RenderView(
        camera_part(whole, first_x, first_y, last_x - first_x, last_y - first_y),
        PixelRect(-first_x, -first_y, *size_px),
        PixelRect(left - first_x, bottom - first_y, right - left, top - bottom),
        pixel_filter,
    )


def viewport_camera(
    view: Sequence[Sequence[float]],
    window: Sequence[Sequence[float]],
    size_px: tuple[int, int],
    bounds_world: np.ndarray,
) -> Camera:
    """Camera of a 3D viewport.

    view, window: 4 x 4 matrices from world to view and from view to the window, as in RegionView3D.
    bounds_world: (2, 3), of all visible objects: an orthographic viewport also shows those behind its eye.
    """
    lens = np.array(window, np.float64)
    from_view = np.linalg.inv(np.array(view, np.float64))
    right, up, back = (from_view[:3, axis] / np.linalg.norm(from_view[:3, axis]) for axis in range(3))
    perspective = lens[3, 3] == 0.0
    half_x, half_y = 1.0 / lens[0, 0], 1.0 / lens[1, 1]
    shift_x, shift_y = (lens[0, 2], lens[1, 2]) if perspective else (-lens[0, 3], -lens[1, 3])
    camera = Camera(
        position_world=from_view[:3, 3],
        right=right,
        up=up,
        forward=-back,
        half_x=float(half_x),
        half_y=float(half_y),
        width_px=size_px[0],
        height_px=size_px[1],
        kind=PERSPECTIVE if perspective else ORTHOGRAPHIC,
        shift_x=float(shift_x),
        shift_y=float(shift_y),
        name="Viewport",
    )
    return camera if perspective else _before_all(camera, bounds_world)


def camera_rect(context: bpy.types.Context) -> PixelRect | None:
    """Rectangle of the picture in a viewport that looks through a camera, else None."""
    view, region = context.region_data, context.region
    item = context.space_data.camera
    if view.view_perspective != "CAMERA" or item is None or item.type != "CAMERA":
        return None
    corners = np.array(item.data.view_frame(scene=context.scene), np.float64)  # (4, 3), in camera space
    seen = np.concatenate([corners, np.ones((4, 1))], axis=1) @ np.array(view.window_matrix, np.float64).T
    pixels = (seen[:, :2] / seen[:, 3:] + 1.0) / 2.0 * (region.width, region.height)
    (left, bottom), (right, top) = (np.rint(pixels.min(axis=0)).astype(int), np.rint(pixels.max(axis=0)).astype(int))
    return PixelRect(int(left), int(bottom), max(int(right - left), 1), max(int(top - bottom), 1))


def _before_all(camera: Camera, bounds_world: np.ndarray) -> Camera:
    """Move an orthographic camera back, in front of a box (2, 3); its picture stays the same."""
    centre, radius = bounds_world.mean(axis=0), np.linalg.norm(np.ptp(bounds_world, axis=0)) / 2
    ahead = float((centre - camera.position_world) @ camera.forward) - radius
    return replace(camera, position_world=camera.position_world + min(ahead, 0.0) * camera.forward)
