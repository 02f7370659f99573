# SPDX-License-Identifier: GPL-3.0-or-later
"""Views for the overlay, by camera, whether they still fit the scene, and their images, named after the camera."""

from __future__ import annotations

import re
from hashlib import blake2b
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from ..scene.cameras import scene_cameras, tracing_camera
from ..scene_access.images import PICTURES, drop_image, show_image
from ..scene_access.own import OWNER
from .scene_session import session_of
from .shown_view import COVERAGE, LEVEL, LUMINANCES, PRIORITY, ShownView

if TYPE_CHECKING:
    from ..computing.views import View


RAW = (PRIORITY, COVERAGE, LEVEL, *LUMINANCES)
PAGES = {"heatmap": 1, "overlay": 1, "error": 2}  # pictures with a legend, and the number of views on them
_NAME = re.compile(r"PatchNet (.+?) ((?:cycles )?\w+)")
_NAME_BYTES = 34  # of a camera's name, so that Blender 4.5 does not truncate the image's name
_SAME = 1e-5  # of lengths and angles that single precision keeps


def image_name(camera: str, name: str) -> str:
    """Name of an image, such as "PatchNet Camera priority"; `name`: of PICTURES or RAW."""
    if len(camera.encode()) > _NAME_BYTES:
        kept = camera.encode()[: _NAME_BYTES - 5].decode(errors="ignore")
        camera = f"{kept}~{blake2b(camera.encode(), digest_size=2).hexdigest()}"  # other names may begin alike
    return f"PatchNet {camera} {name}"


def shown_pictures() -> dict[str, dict[str, str]]:
    """Names of PatchNet's images except the raw ones: camera -> what it shows -> name."""
    found: dict[str, dict[str, str]] = {}
    for name in (image.get(OWNER, "") for image in bpy.data.images):
        match = _NAME.fullmatch(name)
        if match and not name.endswith(RAW):
            found.setdefault(match[1], {})[match[2]] = name
    return found


def show_images(view: View, shown: ShownView) -> Steps[dict[str, bpy.types.Image]]:
    """Create or update all images of a view; raw ones are float, Non-Color. Unknown quantities have none, such as a
    missing reference and errors against it."""
    images, names, label = {}, (*PICTURES, *RAW), f"{view.camera.name}: Showing pictures"
    for number, name in enumerate(names):
        yield Progress(number, len(names), label)
        of, raw = image_name(view.camera.name, name), name in RAW
        picture = (shown.values if raw else view.pictures).get(name)
        if picture is None:
            drop_image(of)
        else:
            images[name] = show_image(of, picture, raw=raw)
    yield Progress(len(names), len(names), label)  # what follows is a step of its own
    return images


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
