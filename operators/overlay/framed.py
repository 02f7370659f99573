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
from .layout import Rect, frame_rect, image_rect

EDITORS = frozenset({"VIEW_3D", "IMAGE_EDITOR"})
_BARS = frozenset({"HEADER", "TOOL_HEADER", "TOOLS", "UI", "ASSET_SHELF", "ASSET_SHELF_HEADER"})


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
    view = views.view_of_camera(scene, camera.name)
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
    view = views.view_of_camera(scene, camera_name(scene, scene.camera))
    if view is None:
        return None
    full, own = camera_size_px(scene), view.size_px
    return view if abs(full[0] / full[1] * own[1] - own[0]) <= 1.0 else None  # within a pixel of the same aspect


def under_mouse(context: bpy.types.Context, event: bpy.types.Event) -> UnderMouse | None:
    """Viewport or Image Editor under the mouse; None over bars and other editors."""
    x, y = event.mouse_x, event.mouse_y
    for area in context.window.screen.areas:
        if area.type not in EDITORS or not _holds(area, x, y):
            continue
        for region in sorted(area.regions, key=lambda item: item.type == "WINDOW"):  # bars lie above
            if _holds(region, x, y):
                if region.type != "WINDOW":
                    return None
                return UnderMouse(region, x - region.x, y - region.y, framed(context.scene, area, region))
    return None


def _holds(item: bpy.types.Area | bpy.types.Region, x: int, y: int) -> bool:
    return item.x <= x < item.x + item.width and item.y <= y < item.y + item.height


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
