# SPDX-License-Identifier: GPL-3.0-or-later
"""Track of a moving camera: frames that voxels of automatic depth are fitted to, and the cameras at each of them.

Farms render a scene in chunks, each a process that sets the frames of its own. The track is of the whole scene, so that
all chunks have the same voxels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...patchnet_addon.runtime.frames import frame_range
from ...patchnet_addon.tracing.camera import Camera
from ..scene_access.window_state import Part
from ..state.digest import composed
from .cameras import camera_names, camera_size_px, cameras_alone, numbered_camera, scene_cameras

_whole = Part("tracks", dict[int, range])  # frames of scenes that a part of them does not change, by their session_uid


def track_frames(scene: bpy.types.Scene, wanted: Sequence[int] = (0, 0)) -> range:
    """Frames of a track: from the first to the last wanted one, for (0, 0) those that the scene renders.

    Without a window these are the frames of the file as it was saved, whatever a command line or a script sets later.
    Raises SettingError where the last frame comes before the first.
    """
    frames = _whole().get(scene.session_uid, _rendered(scene))
    return frame_range(int(wanted[0]), int(wanted[1]), frames.step) if any(wanted) else frames


@contextmanager
def kept_track(scene: bpy.types.Scene) -> Iterator[None]:
    """Keep the track within the block, in which the scene renders other frames."""
    uid = scene.session_uid  # the scene may be gone at the end
    before = _whole().get(uid)
    _whole()[uid] = track_frames(scene)
    try:
        yield
    finally:
        if before is None:
            _whole().pop(uid, None)
        else:
            _whole()[uid] = before


def _rendered(scene: bpy.types.Scene) -> range:
    return range(scene.frame_start, scene.frame_end + 1, scene.frame_step)


def track_cameras(
    scene: bpy.types.Scene, names: Sequence[str], size: tuple[int, int], wanted: Sequence[int] = (0, 0)
) -> list[Camera]:
    """Cameras by name at each frame of a track, each view once; without names that which is active there.

    Evaluates the cameras alone, with parents and constraints, so that the scene stays at its frame and a render can
    call it. Handlers of frames do not run. Raises SceneError for a camera that does not exist.
    """
    views: dict[tuple[object, ...], Camera] = {}
    for number, camera in _views(scene, names, size, track_frames(scene, wanted)):
        values = (*_place(camera), camera.width_px, camera.height_px)
        views.setdefault(values, replace(camera, name=f"{camera.name}, frame {number}"))
    return list(views.values())


def track_key(scene: bpy.types.Scene, wanted: Sequence[int] | None) -> str:
    """Key of the frames of a track and the views through its active camera, without their size; "" for no track."""
    if wanted is None:
        return ""
    frames = track_frames(scene, wanted)
    return composed(repr(frames), *(_place(camera) for _, camera in _views(scene, (), (1, 1), frames)))


def _views(
    scene: bpy.types.Scene, names: Sequence[str], size: tuple[int, int], frames: range
) -> Iterator[tuple[int, Camera]]:
    """Each frame's number with each of its cameras."""
    there = (item for item in scene.timeline_markers if item.camera and not item.camera.hide_render)
    bound = sorted(there, key=lambda item: item.frame)
    first = bound[0].camera if bound else scene.camera  # as Blender chooses before the first marker
    known, named = scene_cameras(scene), [] if bound and not names else camera_names(scene, names)
    own = {item: name for name, item in known.items()}
    with cameras_alone(scene, size) as view:
        for number in frames:
            active = next((item.camera for item in reversed(bound) if item.frame <= number), first)
            chosen = [known.get(name, name) for name in named] if names else [active]
            for item in chosen:
                if isinstance(item, str):
                    camera = numbered_camera(item, camera_size_px(scene, size))
                else:
                    camera = item and replace(view(item, number, 0.0), name=own.get(item, item.name))
                if camera is not None:
                    yield number, camera


def _place(camera: Camera) -> tuple[object, ...]:
    """Values of a view without its size."""
    axes = (camera.position_world, camera.right, camera.up, camera.forward)
    lens = (camera.half_x, camera.half_y, camera.shift_x, camera.shift_y, camera.clip_start, camera.clip_end)
    return (*np.concatenate(axes).round(9).tolist(), *lens, camera.kind)


@persistent
def _on_load(*_: object) -> None:
    _whole().clear()
    if bpy.app.background and bpy.data.filepath:
        for scene in bpy.data.scenes:
            _whole()[scene.session_uid] = _rendered(scene)


HANDLERS = (("load_post", _on_load),)
