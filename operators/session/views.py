# SPDX-License-Identifier: GPL-3.0-or-later
"""Views that can be laid over the scene, by scene and camera, and their staleness; dropped with the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple
from weakref import ReferenceType, ref

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.tracing.camera import Camera
from ..pipeline.views import PICTURES
from ..scene.cameras import tracing_camera
from ..scene_access.own import OWNER
from . import results
from .result_images import RAW, image_name
from .shown_view import ShownView

if TYPE_CHECKING:
    from ...patchnet_addon.octree.octree import Octree

_SAME = 1e-5  # of lengths and angles that single precision keeps


class _Kept(NamedTuple):
    """View, and the octree that it shows, which may be gone."""

    view: ShownView
    octree: ReferenceType[Octree] | None


_views: dict[int, dict[str, _Kept]] = {}


def keep(scene: bpy.types.Scene, view: ShownView) -> None:
    """Keep a view as the result of its camera; it was made from the scene's present octree."""
    result = results.result_of(scene)
    octree = ref(result.octree) if result is not None else None
    _views.setdefault(scene.session_uid, {})[view.camera.name] = _Kept(view, octree)


def forget(scene: bpy.types.Scene) -> None:
    """Free the views of a scene."""
    _views.pop(scene.session_uid, None)


def forget_all() -> None:
    """Free all views."""
    _views.clear()


def all_views() -> list[ShownView]:
    """Views of all scenes and cameras."""
    return [item.view for views in _views.values() for item in views.values()]


def has_views(scene: bpy.types.Scene) -> bool:
    """Return whether there is something to lay over this scene."""
    return bool(_views.get(scene.session_uid))


def view_of_camera(scene: bpy.types.Scene, name: str) -> ShownView | None:
    """Result of the camera called `name`."""
    found = _views.get(scene.session_uid, {}).get(name)
    return found.view if found is not None else None


def view_of_image(scene: bpy.types.Scene, image: bpy.types.Image) -> tuple[ShownView, str] | None:
    """View that an image of ours belongs to, and which of its pictures it is."""
    owner = image.get(OWNER)
    for camera, item in _views.get(scene.session_uid, {}).items():
        for name in (*PICTURES, *RAW):
            if image_name(camera, name) == owner:
                return item.view, name
    return None


def why_stale(scene: bpy.types.Scene, view: ShownView) -> str:
    """Reason for a view being out of date, in a few words; empty if it fits the scene."""
    result, found = results.result_of(scene), _views.get(scene.session_uid, {}).get(view.camera.name)
    if result is None or found is None or found.octree is None or found.octree() is not result.octree:
        return "voxels were made anew"
    for step in ("surface", "light"):
        if step in result.stale:
            return result.why(step) or "the scene changed"
    camera = scene.objects.get(view.camera.name)
    return "the camera changed" if camera is not None and _changed(scene, camera, view.camera) else ""


def _changed(scene: bpy.types.Scene, item: bpy.types.Object, before: Camera) -> bool:
    try:
        now = tracing_camera(item, scene, (before.width_px, before.height_px))
    except PatchNetError:
        return True
    size = 1.0 + float(np.abs(before.position_world).max())
    same = (
        np.allclose(now.position_world, before.position_world, rtol=0.0, atol=_SAME * size)
        and np.allclose(now.up, before.up, atol=_SAME)
        and np.allclose(now.forward, before.forward, atol=_SAME)
        and np.allclose(_lens(now), _lens(before), rtol=_SAME, atol=_SAME)
    )
    return now.kind != before.kind or not same


def _lens(camera: Camera) -> list[float]:
    return [camera.half_x, camera.half_y, camera.shift_x, camera.shift_y, camera.clip_start, camera.clip_end]
