# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene copy that Cycles renders through a camera of the tracer, into a file of all passes.

Python cannot stop a call of the render. In a window, it is a job of Blender, as with F12: steps wait for it, and Esc
stops it.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...patchnet_addon.runtime.errors import PatchNetError, SceneError, SettingError, StoppedError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from ..scene_access.overrides import changed
from ..scene_access.temporary import new_render_results_go, scene_copy, temporary
from ..scene_access.window_job import CANCEL, RENDER, as_job, render_result_hidden, window_is_alive

# Exactly the given number of paths, without clamping; bounces and light stay the user's.
UNBIASED: dict[str, Any] = {
    "use_animated_seed": False,
    "use_adaptive_sampling": False,
    "use_denoising": False,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "film_exposure": 1.0,
    "time_limit": 0.0,
    "use_sample_subset": False,
}

_SENSOR = 36.0  # mm
# Status text of Cycles, equal in all languages.
_SAMPLED = re.compile(r"(?:Rendered (\d+)/(\d+) Tiles, )?Sample (\d+)/(\d+)")


@contextmanager
def prepared(
    context: bpy.types.Context, camera: Camera, samples: int, seed: int, path: Path
) -> Iterator[tuple[bpy.types.Scene, bpy.types.ViewLayer]]:
    """Copy the scene, with `camera` as its camera, and its view layer; raises SceneError, SettingError."""
    if not hasattr(context.scene, "cycles"):
        raise SceneError("The Cycles render engine is disabled: enable its add-on")
    with ExitStack() as stack:
        stack.enter_context(new_render_results_go())
        scene = stack.enter_context(scene_copy(context.scene))
        _set_up(scene, camera, samples, seed, path)
        size = camera.width_px, camera.height_px
        if size != (scene.render.resolution_x, scene.render.resolution_y):
            raise SettingError(f"Blender renders no picture of {size[0]} x {size[1]} pixels: take sides of 4 to 65,536")
        for item in scene.objects:
            if item.type == "LIGHT":  # no surface, and not in the octree
                stack.enter_context(changed(item, visible_camera=False))
        stack.enter_context(looking_through(scene, camera))
        layer = scene.view_layers[context.view_layer.name]
        layer.samples = 0  # the scene's
        # Instead of use_single_layer, with which Blender 5.2 cannot render a scene of many layers twice.
        scene.render.use_single_layer = False
        for other in scene.view_layers:
            other.use = other == layer
        yield scene, layer


def _set_up(scene: bpy.types.Scene, camera: Camera, samples: int, seed: int, path: Path) -> None:
    """Set a box filter and unbiased sampling; bounces, device and light are the user's, as in the bake.

    The file is an uncompressed EXR of all passes. The media type decides the file formats, so it is set first. Markers
    are removed, because Blender takes the scene's camera from the frame's marker. A locked interface would block the
    window.
    """
    scene.timeline_markers.clear()
    unit_x, unit_y = camera.half_x / camera.width_px, camera.half_y / camera.height_px
    image = {
        "media_type": "MULTI_LAYER_IMAGE",
        "file_format": "OPEN_EXR_MULTILAYER",
        "color_mode": "RGBA",
        "color_depth": "32",
        "exr_codec": "NONE",
    }
    render = {
        "engine": "CYCLES",
        "resolution_x": camera.width_px,
        "resolution_y": camera.height_px,
        "resolution_percentage": 100,
        "pixel_aspect_x": max(1.0, unit_x / unit_y),
        "pixel_aspect_y": max(1.0, unit_y / unit_x),
        "filepath": str(path),
        "use_file_extension": False,
        "use_overwrite": True,
        "use_compositing": False,
        "use_sequencer": False,
        "use_border": False,
        "use_multiview": False,
        "use_motion_blur": False,
        "use_freestyle": False,
        "use_lock_interface": False,
        "film_transparent": True,
    }
    cycles = UNBIASED | {
        "samples": samples,
        "seed": seed,
        "pixel_filter_type": "BOX",
        "film_transparent_glass": False,
    }
    for owner, values in ((scene.render.image_settings, image), (scene.render, render), (scene.cycles, cycles)):
        for name, value in values.items():
            if hasattr(owner, name):
                setattr(owner, name, value)


@contextmanager
def looking_through(scene: bpy.types.Scene, camera: Camera) -> Iterator[None]:
    """Give `scene` a camera with the view of `camera`, without depth of field, within the block."""
    with (
        temporary(bpy.data.cameras.new("PatchNet Check")) as data,
        temporary(bpy.data.objects.new("PatchNet Check", data)) as item,
    ):
        data.type, data.sensor_fit, data.sensor_width = camera.kind, "HORIZONTAL", _SENSOR
        if camera.kind == ORTHOGRAPHIC:
            data.ortho_scale = 2.0 * camera.half_x
        else:
            data.lens = _SENSOR / (2.0 * camera.half_x)
        data.shift_x = camera.shift_x / 2.0
        data.shift_y = camera.shift_y * camera.half_y / (2.0 * camera.half_x)
        data.clip_start, data.clip_end = max(camera.clip_start, 1e-5), min(camera.clip_end, 1e9)
        axes = np.stack([camera.right, camera.up, -np.asarray(camera.forward), camera.position_world], axis=1)
        item.matrix_world = Matrix([*axes.tolist(), [0.0, 0.0, 0.0, 1.0]])
        scene.collection.objects.link(item)
        scene.camera = item
        yield


def render(scene: bpy.types.Scene, path: Path) -> float:
    """Render the copy's view layer into `path`, a new file; return the seconds.

    Raises SceneError if Cycles does not render, PatchNetError if it wrote no file.
    """
    path.unlink(missing_ok=True)
    begun = time.perf_counter()
    _called(scene, "EXEC_DEFAULT")
    _check_written(path)
    return time.perf_counter() - begun


def rendered(scene: bpy.types.Scene, path: Path, at: Callable[[float], Progress]) -> Steps[float]:
    """Render as `render`, but as a job if a window waits; reports are `at` of the share of finished samples.

    Raises StoppedError if the user stops it.
    """
    if not window_is_alive():
        return render(scene, path)
    path.unlink(missing_ok=True)
    status, begun = _Status(), time.perf_counter()
    with render_result_hidden(bpy.context.window_manager):
        bpy.app.handlers.render_stats.append(status.hear)
        try:
            ended = yield from as_job(RENDER, scene, lambda: _invoked(scene), lambda: at(status.done))
        finally:
            if status.hear in bpy.app.handlers.render_stats:  # opening another file removes it
                bpy.app.handlers.render_stats.remove(status.hear)
    if CANCEL in ended:
        raise StoppedError("The render was stopped")
    status.check_finished()
    _check_written(path)
    return max(ended.values(), default=time.perf_counter()) - begun


class _Status:
    """Status of a Cycles render, heard in its thread: share of finished samples, 0 to 1, and its end."""

    def __init__(self) -> None:
        self.done = 0.0
        self._finished = False
        self._last = ""

    def check_finished(self) -> None:
        """Raise SceneError for a failed render, which also writes a picture, such as without enough GPU memory."""
        if self._last and not self._finished:
            raise SceneError(f"Cycles did not finish the picture ({self._last}): Blender's terminal may say more")

    def hear(self, text: object, *_: object) -> None:
        """Parse a line of Blender's status, which ends with the status of Cycles; Blender calls this."""
        if not isinstance(text, str) or "|" not in text:
            return
        self._last = text.rsplit("|", 1)[1].strip()
        self._finished |= self._last == "Finished"
        found = _SAMPLED.search(self._last)
        if found is None:
            return
        tile, tiles, sample, samples = (int(number) if number else 0 for number in found.groups())
        # A tile counts as finished before the next one reports its first sample.
        part = (sample % samples) / samples if samples else 0.0
        self.done = max(self.done, min(1.0, (tile + part) / max(tiles, 1)))


def _invoked(scene: bpy.types.Scene) -> None:
    """Start the render without an editor or window, which Blender would open only while the job starts."""
    preferences = bpy.context.preferences
    was_dirty = preferences.is_dirty
    try:
        with changed(preferences.view, render_display_type="NONE"):
            _called(scene, "INVOKE_DEFAULT")
    finally:
        preferences.is_dirty = was_dirty


def _called(scene: bpy.types.Scene, how: str) -> None:
    try:
        bpy.ops.render.render(how, write_still=True, scene=scene.name)
    except RuntimeError as cause:
        raise SceneError(f"Cycles cannot render the scene ({str(cause).strip().removeprefix('Error: ')})") from cause


def _check_written(path: Path) -> None:
    if not path.is_file():
        raise PatchNetError("Cycles wrote no picture: check that the folder for temporary files has room")
