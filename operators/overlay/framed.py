# SPDX-License-Identifier: GPL-3.0-or-later
"""Lookup of the view that lies in an editor's region, and of its rectangle there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.image.heatmap import places_on_page
from ...patchnet_addon.tracing.camera import Camera
from ..jobs.job_window import inside
from ..scene.cameras import camera_name, camera_size_px
from ..session import views
from ..session.scene_session import session_of
from ..session.shown_view import ShownView
from ..session.views import PAGES

EDITORS = frozenset({"VIEW_3D", "IMAGE_EDITOR"})
_BARS = frozenset({"HEADER", "TOOL_HEADER", "TOOLS", "UI", "ASSET_SHELF", "ASSET_SHELF_HEADER"})


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


class Framed(NamedTuple):
    """View and the rectangles of its picture, in pixels of the region; the page of errors has two."""

    view: ShownView
    rects: tuple[Rect, ...]


class UnderMouse(NamedTuple):
    """Region under the mouse, position of the mouse in its pixels, and the view shown there."""

    region: bpy.types.Region
    x: float
    y: float
    framed: Framed | None


def framed(scene: bpy.types.Scene, area: bpy.types.Area, region: bpy.types.Region) -> Framed | None:
    """Find the view in a WINDOW region of a 3D viewport or an Image Editor; None if it shows no view of PatchNet."""
    space = area.spaces.active
    return _in_viewport(scene, space, region) if area.type == "VIEW_3D" else _in_image_editor(scene, space, region)


def _in_viewport(scene: bpy.types.Scene, space: bpy.types.SpaceView3D, region: bpy.types.Region) -> Framed | None:
    view3d = region.data
    camera = space.camera if space.use_local_camera else scene.camera
    if view3d is None or view3d.view_perspective != "CAMERA" or camera is None:
        return None
    view = session_of(scene).views.get(camera.name)
    if view is None:
        return None
    rect = frame_rect(view.camera, view3d.window_matrix, region.width, region.height)
    return Framed(view, (rect,)) if rect is not None else None


def _in_image_editor(
    scene: bpy.types.Scene, space: bpy.types.SpaceImageEditor, region: bpy.types.Region
) -> Framed | None:
    image, to_view = space.image, region.view2d.region_to_view
    if image is None:
        return None
    page = image_rect(to_view(0, 0), to_view(region.width, region.height), region.width, region.height)
    view, name = views.view_of_image(scene, image) or (_of_render(scene, image), "")
    if page is None or view is None:
        return None
    if name not in PAGES:
        return Framed(view, (page,))
    shares = places_on_page(tuple(image.size), view.size_px, PAGES[name])
    return Framed(view, tuple(page.part(Rect(*share)) for share in shares))


def _of_render(scene: bpy.types.Scene, image: bpy.types.Image) -> ShownView | None:
    """View of the scene's camera if a render shows the same part of the scene."""
    render = scene.render
    if image.type != "RENDER_RESULT" or scene.camera is None or (render.use_border and render.use_crop_to_border):
        return None
    view = session_of(scene).views.get(camera_name(scene, scene.camera))
    if view is None:
        return None
    full, own = camera_size_px(scene), view.size_px
    return view if abs(full[0] / full[1] * own[1] - own[0]) <= 1.0 else None  # within a pixel of the same aspect


def under_mouse(context: bpy.types.Context, event: bpy.types.Event) -> UnderMouse | None:
    """Viewport or Image Editor under the mouse; None over bars and other editors."""
    for area in context.window.screen.areas:
        if area.type not in EDITORS or not inside(area, event):
            continue
        for region in sorted(area.regions, key=lambda item: item.type == "WINDOW"):  # bars lie above
            if inside(region, event):
                if region.type != "WINDOW":
                    return None
                x, y = event.mouse_x - region.x, event.mouse_y - region.y
                return UnderMouse(region, x, y, framed(context.scene, area, region))
    return None


def free_rect(area: bpy.types.Area, region: bpy.types.Region) -> Rect:
    """Part of a region that overlapping headers and sidebars leave free, in its pixels."""
    left, bottom, right, top = 0.0, 0.0, float(region.width), float(region.height)
    for bar in area.regions:
        x, y = bar.x - region.x, bar.y - region.y
        if bar.type not in _BARS or min(bar.width, bar.height) <= 1:
            continue
        if bar.alignment == "LEFT":
            left = max(left, x + bar.width)
        elif bar.alignment == "RIGHT":
            right = min(right, x)
        elif bar.alignment == "BOTTOM":
            bottom = max(bottom, y + bar.height)
        elif bar.alignment == "TOP":
            top = min(top, y)
    return Rect(left, bottom, right, top)
