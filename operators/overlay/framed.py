# SPDX-License-Identifier: GPL-3.0-or-later
"""Lookup of the view that lies in an editor's region, and of its rectangle there."""

from __future__ import annotations

from typing import NamedTuple

import bpy

from ...patchnet_addon.image.heatmap import places_on_page
from ..scene.cameras import camera_name, camera_size_px
from ..session import views
from ..session.result_images import PAGES
from ..session.shown_view import ShownView
from .layout import Rect, frame_rect, image_rect, visible_rect

EDITORS = frozenset({"VIEW_3D", "IMAGE_EDITOR"})
_BARS = frozenset({"HEADER", "TOOL_HEADER", "TOOLS", "UI", "ASSET_SHELF", "ASSET_SHELF_HEADER"})


class Framed(NamedTuple):
    """View and the rectangles where its picture lies, in pixels of the region: two on the page of errors."""

    view: ShownView
    rects: tuple[Rect, ...]

    @property
    def rect(self) -> Rect | None:
        """Rectangle where the overlay is drawn: none if the picture is there twice."""
        return self.rects[0] if len(self.rects) == 1 else None


class CursorPosition(NamedTuple):
    """Region under the mouse, and the mouse in its pixels."""

    area: bpy.types.Area
    region: bpy.types.Region
    x: float
    y: float


def framed(scene: bpy.types.Scene, area: bpy.types.Area, region: bpy.types.Region) -> Framed | None:
    """Find the view in a WINDOW region of a 3D viewport or an Image Editor; None if no view of ours lies there."""
    if area.type == "VIEW_3D":
        return _in_viewport(scene, area.spaces.active, region)
    if area.type == "IMAGE_EDITOR":
        return _in_image_editor(scene, area.spaces.active, region)
    return None


def _in_viewport(scene: bpy.types.Scene, space: bpy.types.SpaceView3D, region: bpy.types.Region) -> Framed | None:
    view3d = region.data
    camera = space.camera if space.use_local_camera else scene.camera
    if view3d is None or view3d.view_perspective != "CAMERA" or camera is None:
        return None
    view = views.view_of_camera(scene, camera.name)
    if view is None:
        return None
    rect = frame_rect(view.camera, view3d.window_matrix, region.width, region.height)
    return Framed(view, (rect,)) if rect is not None else None


def _in_image_editor(
    scene: bpy.types.Scene, space: bpy.types.SpaceImageEditor, region: bpy.types.Region
) -> Framed | None:
    image = space.image
    if image is None:
        return None
    low = region.view2d.region_to_view(0, 0)
    high = region.view2d.region_to_view(region.width, region.height)
    page = image_rect(low, high, region.width, region.height)
    found = views.view_of_image(scene, image)
    if page is None:
        return None
    if found is None:
        view = _of_render(scene, image)
        return Framed(view, (page,)) if view is not None else None
    view, name = found
    if name not in PAGES:
        return Framed(view, (page,))
    width, height = view.size_px
    shares = places_on_page(tuple(image.size), (width, height), PAGES[name])
    return Framed(view, tuple(page.part(Rect(*share)) for share in shares))


def _of_render(scene: bpy.types.Scene, image: bpy.types.Image) -> ShownView | None:
    """View of the scene's camera if a render shows the same part of the scene."""
    render = scene.render
    if image.type != "RENDER_RESULT" or scene.camera is None or (render.use_border and render.use_crop_to_border):
        return None
    view = views.view_of_camera(scene, camera_name(scene, scene.camera))
    if view is None:
        return None
    full, own = camera_size_px(scene), view.size_px
    return view if abs(full[0] / full[1] * own[1] - own[0]) <= 1.0 else None  # within a pixel of the same aspect


def position_under(window: bpy.types.Window, x: int, y: int) -> CursorPosition | None:
    """Viewport or Image Editor under the mouse at x, y in the window; None over bars and other editors."""
    for area in window.screen.areas:
        if area.type not in EDITORS or not _holds(area, x, y):
            continue
        for region in sorted(area.regions, key=lambda item: item.type == "WINDOW"):  # bars lie above
            if _holds(region, x, y):
                return CursorPosition(area, region, x - region.x, y - region.y) if region.type == "WINDOW" else None
    return None


def _holds(item: bpy.types.Area | bpy.types.Region, x: int, y: int) -> bool:
    return item.x <= x < item.x + item.width and item.y <= y < item.y + item.height


def free_rect(area: bpy.types.Area, region: bpy.types.Region) -> Rect:
    """Rectangle that headers and sidebars leave of a region, in its pixels."""

    def rect(item: bpy.types.Region) -> Rect:
        left, bottom = item.x - region.x, item.y - region.y
        return Rect(left, bottom, left + item.width, bottom + item.height)

    bars = [rect(item) for item in area.regions if item.type in _BARS and min(item.width, item.height) > 1]
    return visible_rect(Rect(0.0, 0.0, region.width, region.height), bars)
