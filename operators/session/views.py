# SPDX-License-Identifier: GPL-3.0-or-later
"""Views for the overlay, by camera, and whether they still fit the scene."""

from __future__ import annotations

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.tracing.camera import Camera
from ..scene.cameras import scene_cameras, tracing_camera
from ..scene_access.images import PICTURES
from ..scene_access.own import OWNER
from .result_images import RAW, image_name
from .scene_session import session_of
from .shown_view import ShownView

_SAME = 1e-5  # of lengths and angles that single precision keeps


def keep_view(scene: bpy.types.Scene, view: ShownView) -> None:
    """Keep a view in place of the last one of its camera."""
    session_of(scene).views[view.camera.name] = view


def has_views(scene: bpy.types.Scene) -> bool:
    """Return whether the scene has a view for the overlay."""
    return bool(session_of(scene).views)


def view_of_camera(scene: bpy.types.Scene, name: str) -> ShownView | None:
    """View of the camera called `name`."""
    return session_of(scene).views.get(name)


def view_of_image(scene: bpy.types.Scene, image: bpy.types.Image) -> tuple[ShownView, str] | None:
    """View of one of PatchNet's images, and the name of its picture."""
    owner = image.get(OWNER)
    for camera, view in session_of(scene).views.items():
        for name in (*PICTURES, *RAW):
            if image_name(camera, name) == owner:
                return view, name
    return None


def why_stale(scene: bpy.types.Scene, view: ShownView) -> str:
    """Reason why a view is out of date, in a few words; empty if it fits the scene."""
    result = session_of(scene).result
    if result is None or view.octree() is not result.octree:
        return "voxels were made anew"
    for step in ("surface", "light"):
        if step in result.stale:
            return result.why(step) or "the scene changed"
    return camera_change(scene, view)


def camera_change(scene: bpy.types.Scene, view: ShownView) -> str:
    """Sentence if the camera of a view has changed, else ""."""
    camera = scene_cameras(scene).get(view.camera.name)
    return "the camera changed" if camera is not None and _changed(scene, camera, view.camera) else ""


def _changed(scene: bpy.types.Scene, item: bpy.types.Object, before: Camera) -> bool:
    try:
        now = tracing_camera(item, scene, (before.width_px, before.height_px))
    except PatchNetError:
        return True
    size = 1.0 + float(np.abs(before.position_world).max())
    same_place = (
        np.allclose(now.position_world, before.position_world, rtol=0.0, atol=_SAME * size)
        and np.allclose(now.up, before.up, atol=_SAME)
        and np.allclose(now.forward, before.forward, atol=_SAME)
    )
    same_lens = now.kind == before.kind and np.allclose(_lens(now), _lens(before), rtol=_SAME, atol=_SAME)
    return not same_lens or (not same_place and _is_placed(scene, item))


def _is_placed(scene: bpy.types.Scene, item: bpy.types.Object) -> bool:
    """Return whether Blender evaluates a camera: not if all view layers exclude it."""
    graphs = (layer.depsgraph for layer in scene.view_layers)
    return any(graph is not None and item.evaluated_get(graph).is_evaluated for graph in graphs)


def _lens(camera: Camera) -> list[float]:
    return [camera.half_x, camera.half_y, camera.shift_x, camera.shift_y, camera.clip_start, camera.clip_end]
