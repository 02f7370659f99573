# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles renders of any pixels of one camera's picture.

Cycles reads the scene once and keeps it (Persistent Data), so that each further call costs its paths and about 0.05 s.
A temporary copy of the scene holds all settings.

A holdout before the camera, with holes where pixels are wanted, limits a render to them. A pixel behind it costs one
ray. Rays through a hole meet nothing of it, so that these pixels get the samples of a whole render. Only camera rays
meet it: it changes no light and no shadow.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.image.cycles_passes import (
    ReadPicture,
    baked_light,
    baked_light_with_gloss,
    combined_light,
    picture_of,
)
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import PERSPECTIVE, Camera
from ..computing.cycles_pixels import Chosen
from ..scene_access.polygons import add_polygons
from ..scene_access.temporary import temporary
from ..scene_access.window_job import check_no_job, window_is_alive
from ..schema.values import COMBINED, DIFFUSE
from ..settings.cycles_settings import WITH_GLOSS
from .camera_render import add_passes
from .daylight import daylight
from .scene_copy import prepared, rendered

_ONLY_CAMERA = (
    "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter", "visible_shadow",
)  # fmt: skip
_BEYOND_CLIP = 1.01  # of the clip start
_GAP_PX, _GAP_STEPS = 1e-3, 4.0  # around holes, at least: of a pixel, and steps of float32 there
# Work between two reports in background. In a window, Blender's job reports progress, and polls for a stop between two
# passes over a tile, for which the tiles of Cycles are too large.
PART_S = 1.0
FIRST_PATHS = 50_000
TILE_SIDE_IN_WINDOW = 256
_LIGHTS = {DIFFUSE: baked_light, WITH_GLOSS: baked_light_with_gloss, COMBINED: combined_light}
_INSIDE = 0.25  # of a pixel, so that borders, float32 shares of the picture, round to the right pixel


@contextmanager
def mask_plane(scene: bpy.types.Scene, camera: Camera, mask: np.ndarray, depth_world: float) -> Iterator[None]:
    """Put the holdout into a scene copy within the block, before all pixels that are not in `mask`.

    mask: (H, W) bool, row 0 at the bottom. depth_world: of the nearest surface. The holdout stands halfway to it: much
    nearer, float32 would not resolve its pixels in a large scene.
    """
    depth_world = max(camera.clip_start * _BEYOND_CLIP, min(depth_world, camera.clip_end) / 2.0)
    with ExitStack() as stack:
        mesh = stack.enter_context(temporary(bpy.data.meshes.new("PatchNet Mask")))
        add_polygons(mesh, _corners(camera, mask, depth_world))
        mesh.update(calc_edges=True)
        item = stack.enter_context(temporary(bpy.data.objects.new("PatchNet Mask", mesh)))
        item.location, item.is_holdout = camera.position_world, True
        for name in _ONLY_CAMERA:
            setattr(item, name, False)
        scene.collection.objects.link(item)
        yield


def _corners(camera: Camera, mask: np.ndarray, depth_world: float) -> np.ndarray:
    """(N, 4, 3) float64: a rectangle for each run of pixels without `mask` in a row, from the camera's position.

    They are slightly smaller than their pixels, so that no rounding lets them cut off a part of a hole.
    """
    height, width = mask.shape
    spread = depth_world if camera.kind == PERSPECTIVE else 1.0
    across, up = np.asarray(camera.right) * camera.half_x * spread, np.asarray(camera.up) * camera.half_y * spread
    pixel_world = 2.0 * spread * min(camera.half_x / width, camera.half_y / height)
    step_world = np.spacing(np.float32(np.abs(camera.position_world).max() + depth_world))
    gap = max(_GAP_PX, _GAP_STEPS * float(step_world) / pixel_world)
    changes = np.diff(np.pad(mask, ((0, 0), (1, 1)), constant_values=True).astype(np.int8))
    (row, first), (_, end) = np.nonzero(changes < 0), np.nonzero(changes > 0)
    left, right, low, high = first + gap, end - gap, row + gap, row + 1.0 - gap
    there = (left < right) & (low < high)
    x = np.stack([left, right, right, left], axis=1)[there] / width * 2.0 - 1.0 + camera.shift_x
    y = np.stack([low, low, high, high], axis=1)[there] / height * 2.0 - 1.0 + camera.shift_y
    result: np.ndarray = np.asarray(camera.forward) * depth_world + x[..., None] * across + y[..., None] * up
    return result


class PixelRenders:
    """Renderer of one camera's pixels; made by `pixel_renders`.

    seconds: of all renders and of reading their files. sync_seconds: of the first render, which reads the scene.
    """

    def __init__(self, scene: bpy.types.Scene, path: Path, mask: np.ndarray, light: str) -> None:
        self._scene, self._path, self._mask = scene, path, mask
        self._light = _LIGHTS[light]
        self.seconds = self.sync_seconds = 0.0

    def synced(self) -> Steps[None]:
        """Let Cycles read the scene by a render of one pixel, to measure its time."""
        self._sample(1, 0)
        yield from self._part(slice(0, 1), lambda share: Progress(share, 1, "Cycles reads the scene"), columns=1)
        self.sync_seconds = self.seconds

    def picture(self, samples: int, seed: int, label: str, *, at_once: bool = False) -> Steps[np.ndarray]:
        """(H, W, 4) float32: linear unexposed light, and alpha; row 0 at the bottom; 0 in pixels outside of the mask.

        In background, in parts of about a second, unless `at_once`. Raises SceneError, StoppedError.
        """
        canvas = np.zeros((*self._mask.shape, 4), np.float32)
        of_rows = self._mask.sum(axis=1)
        rows, done, pace = np.flatnonzero(of_rows), 0, FIRST_PATHS / samples
        self._sample(samples, seed)
        while len(rows):
            fits = int(np.searchsorted(np.cumsum(of_rows[rows]), pace * PART_S, "right"))
            taken = len(rows) if at_once or window_is_alive() else max(1, fits)
            part, rows = slice(int(rows[0]), int(rows[taken - 1]) + 1), rows[taken:]
            begun, work = self.seconds, int(of_rows[part].sum())
            picture = yield from self._part(part, _reports(done, work, int(of_rows.sum()), label))
            pace, done = work / max(self.seconds - begun, 1e-3), done + work
            canvas[part] = picture
        return canvas

    def _sample(self, samples: int, seed: int) -> None:
        self._scene.cycles.samples, self._scene.cycles.seed = samples, seed
        self._scene.update_tag()  # otherwise Cycles keeps the old values

    def _part(self, rows: slice, at: Callable[[float], Progress], columns: int | None = None) -> Steps[np.ndarray]:
        """(h, w, 4) float32: some rows of the picture, or the first columns of them; 0 outside of the mask."""
        yield at(0.0)
        height, width = self._mask.shape
        values = self._scene.render
        values.use_border = values.use_crop_to_border = True
        values.border_min_x, values.border_max_x = 0.0, 1.0 if columns is None else (columns + _INSIDE) / width
        values.border_min_y, values.border_max_y = 0.0, 1.0  # Blender keeps them in order while they are set
        values.border_max_y, values.border_min_y = (rows.stop + _INSIDE) / height, (rows.start + _INSIDE) / height
        self.seconds += yield from rendered(self._scene, self._path, at)
        result: ReadPicture = yield from computed(
            picture_of, self._path, self._light, self._mask[rows, :columns], at=at(1.0)
        )
        self.seconds += result.seconds
        return result.pixels


@contextmanager
def pixel_renders(
    context: bpy.types.Context,
    camera: Camera,
    light: str,
    chosen: Chosen | None = None,
    *,
    sun: bool = False,
) -> Iterator[PixelRenders]:
    """Renderer of pixels of the scene.

    chosen: the pixels to render; None for whole pictures. sun: with our sun and sky. Raises SceneError without Cycles,
    or if another render or bake job runs in a window.
    """
    if window_is_alive():
        check_no_job()
    with ExitStack() as stack:
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="patchnet-"))) / "pixels.exr"
        scene, layer = stack.enter_context(prepared(context, camera, 1, 0, path))
        add_passes(layer)
        if window_is_alive() and scene.cycles.device == "CPU":  # a GPU renders large tiles fast
            scene.cycles.use_auto_tile, scene.cycles.tile_size = True, TILE_SIDE_IN_WINDOW
        if sun:
            stack.enter_context(daylight(scene))
        if chosen is None:
            chosen = Chosen(np.ones((camera.height_px, camera.width_px), bool), np.inf)
        else:
            stack.enter_context(mask_plane(scene, camera, *chosen))
        scene.render.use_persistent_data = True
        stack.callback(_drop_kept, scene)
        yield PixelRenders(scene, path, chosen.mask, light)


def _drop_kept(scene: bpy.types.Scene) -> None:
    """Free the persistent data of `scene` before its data-blocks are removed."""
    with suppress(ReferenceError):  # a stopped render deletes the scene
        scene.render.use_persistent_data = False


def _reports(done: int, work: int, total: int, label: str) -> Callable[[float], Progress]:
    return lambda share: Progress(done + share * work, total, label)
