# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles renders of regions of one camera's picture, bit for bit the same pixels as a render of all of it.

Cycles reads the scene once and keeps it ("persistent data"), so that each further region costs its paths and some
0.05 s. All settings are those of a scene of our own, which is gone afterwards with what Cycles kept.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.image.exr import read_exr
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.worker import computed
from ...patchnet_addon.sampling.regions import Region
from ...patchnet_addon.tracing.camera import Camera
from ..scene_access.window_job import check_no_job, window_is_alive
from ..schema.table import COMBINED, DIFFUSE
from ..settings.cycles_settings import WITH_GLOSS
from .camera_render import add_passes, baked_light, baked_light_with_gloss, combined_light, coverage
from .daylight import daylight
from .render_call import rendered
from .scene_copy import prepared

# What a call costs beside its pixels, as paths: 0.03 to 0.07 s at 0.03 M paths/s, on the demo courtyard and two busy
# CPU cores.
OVERHEAD_PATHS = 1_500
# Without a window nothing acts while Blender renders: so much work between two reports. Beside a window Blender's job
# says how far it is, and hears of a stop between two passes over a tile: those of Cycles are too large for that.
PART_S = 1.0
FIRST_PATHS = 50_000
TILE_SIDE_IN_WINDOW = 256
_LIGHTS = {DIFFUSE: baked_light, WITH_GLOSS: baked_light_with_gloss, COMBINED: combined_light}
_INSIDE = 0.25  # of a pixel, so that borders, which Blender keeps as float32 shares, are cut to the right one


class RegionRenders:
    """Renderer of parts of a picture; made by `region_renders`.

    seconds: of Blender's renders up to now and of reading their files, without those of the caller that waited.
    sync_seconds: of the first, which reads the scene.
    """

    def __init__(self, scene: bpy.types.Scene, path: Path, camera: Camera, light: str) -> None:
        self._scene, self._path = scene, path
        self._size = camera.width_px, camera.height_px
        self._light = _LIGHTS[light]
        self.seconds = self.sync_seconds = 0.0

    def sample(self, samples: int, seed: int) -> None:
        """Paths per pixel, and their seed, of what is rendered from now on."""
        self._scene.cycles.samples, self._scene.cycles.seed = samples, seed
        self._scene.update_tag()  # or Cycles goes on with those that it kept

    def synced(self) -> Steps[None]:
        """Let Cycles read the scene, with one pixel, so that the time of that is known."""
        yield from self.picture(Region(0, 0, 1, 1), lambda share: Progress(share, 1, "Cycles reads the scene"))
        self.sync_seconds = self.seconds

    def picture(self, region: Region, at: Callable[[float], Progress]) -> Steps[np.ndarray]:
        """(h, w, 4) float32: linear unexposed light, and alpha; row 0 at the bottom. Raises SceneError, StoppedError.

        Reports are `at` of the share that is done.
        """
        yield at(0.0)
        self._crop(region)
        self.seconds += yield from rendered(self._scene, self._path, at)
        begun = time.perf_counter()
        channels = read_exr(self._path)
        self.seconds += time.perf_counter() - begun
        result = yield from computed(lambda: np.dstack([self._light(channels), coverage(channels)]), at(1.0))
        assert result.shape == (region.height, region.width, 4)
        return result

    def pictures(self, regions: Sequence[Region], label: str) -> Steps[np.ndarray]:
        """(H, W, 4) float32: all regions in an empty picture; without a window in parts of about a second."""
        width, height = self._size
        canvas = np.zeros((height, width, 4), np.float32)
        total, done = sum(region.pixels for region in regions), 0
        part_px = FIRST_PATHS // self._scene.cycles.samples
        for region in regions:
            rest: Region | None = region
            while rest is not None:
                part, rest = (rest, None) if window_is_alive() else rest.split(part_px)
                begun = self.seconds
                canvas[part.slices] = yield from self.picture(part, _reports(done, part.pixels, total, label))
                part_px = max(1, int(part.pixels * PART_S / max(self.seconds - begun, 1e-3)))
                done += part.pixels
        return canvas

    def _crop(self, region: Region) -> None:
        width, height = self._size
        values = self._scene.render
        values.use_border = values.use_crop_to_border = True
        values.border_min_x, values.border_max_x = 0.0, 1.0  # Blender keeps them in order while they are set
        values.border_min_y, values.border_max_y = 0.0, 1.0
        values.border_max_x = (region.left + region.width + _INSIDE) / width
        values.border_min_x = (region.left + _INSIDE) / width
        values.border_max_y = (region.bottom + region.height + _INSIDE) / height
        values.border_min_y = (region.bottom + _INSIDE) / height


@contextmanager
def region_renders(
    context: bpy.types.Context, camera: Camera, samples: int, seed: int, light: str, *, sun: bool = False
) -> Iterator[RegionRenders]:
    """Renders of the scene, which is as before after the block.

    Raises SceneError if Cycles is not there, or if Blender renders or bakes something else beside its window.
    sun: with a sun and a sky of ours, in the copy of the scene only.
    """
    if window_is_alive():
        check_no_job()
    with ExitStack() as stack:
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="patchnet-"))) / "region.exr"
        scene, layer = stack.enter_context(prepared(context, camera, samples, seed, path))
        add_passes(layer)
        if window_is_alive() and scene.cycles.device == "CPU":  # a GPU is done with large tiles soon
            scene.cycles.use_auto_tile, scene.cycles.tile_size = True, TILE_SIDE_IN_WINDOW
        if sun:
            stack.enter_context(daylight(scene))
        scene.render.use_persistent_data = True
        stack.callback(_drop_kept, scene)
        yield RegionRenders(scene, path, camera, light)


def _drop_kept(scene: bpy.types.Scene) -> None:
    """Drop what Cycles kept of `scene`, before anything of that is removed."""
    with suppress(ReferenceError):  # the scene has gone with a render that was stopped
        scene.render.use_persistent_data = False


def _reports(done: int, pixels: int, total: int, label: str) -> Callable[[float], Progress]:
    return lambda share: Progress(done + share * pixels, total, label)
