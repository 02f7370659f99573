# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles renders of regions of one camera's picture, bit for bit the same pixels as a render of all of it.

Cycles reads the scene once and keeps it ("persistent data"), so that each further region costs its paths and some
0.05 s. All settings are those of a scene of our own, which is gone afterwards with what Cycles kept.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.image.exr import read_exr
from ...patchnet_addon.progress import Progress, Steps
from ...patchnet_addon.sampling.regions import Region
from ...patchnet_addon.tracing.camera import Camera
from ..daylight import daylight
from ..verify_light.reference import add_passes, baked_light, combined_light
from ..verify_light.scene_copy import prepared, render
from .settings import COMBINED

# What a call costs beside its pixels, as paths: 0.03 to 0.07 s at 0.03 M paths/s, on the demo courtyard and two busy
# CPU cores.
OVERHEAD_PATHS = 1_500
_PART_S = 1.0  # of work between two reports
_FIRST_PATHS = 50_000
_INSIDE = 0.25  # of a pixel, so that borders, which Blender keeps as float32 shares, are cut to the right one


class RegionRenders:
    """Renders parts of a picture; made by `region_renders`.

    seconds: wall time of Blender's calls up to now. sync_seconds: of the first, which reads the scene.
    """

    def __init__(self, scene: bpy.types.Scene, path: Path, camera: Camera, light: str) -> None:
        self._scene, self._path = scene, path
        self._size = camera.width_px, camera.height_px
        self._light = combined_light if light == COMBINED else baked_light
        self.seconds = self.sync_seconds = 0.0

    def sample(self, samples: int, seed: int) -> None:
        """Paths per pixel, and their seed, of what is rendered from now on."""
        self._scene.cycles.samples, self._scene.cycles.seed = samples, seed

    def synced(self) -> Steps[None]:
        """Let Cycles read the scene, with one pixel, so that the time of that is known."""
        yield Progress(0, 1, "Cycles reads the scene")
        self.picture(Region(0, 0, 1, 1))
        self.sync_seconds = self.seconds

    def picture(self, region: Region) -> np.ndarray:
        """(h, w, 3) float32, linear and unexposed, row 0 at the bottom. Raises SceneError, StoppedError."""
        begun = time.perf_counter()
        self._crop(region)
        render(self._scene, self._path)
        result = self._light(read_exr(self._path))
        self.seconds += time.perf_counter() - begun
        assert result.shape == (region.height, region.width, 3)
        return result

    def pictures(self, regions: Sequence[Region], label: str) -> Steps[np.ndarray]:
        """(H, W, 3) float32: all regions in a black picture, in parts of about a second, so that it can be stopped."""
        width, height = self._size
        canvas = np.zeros((height, width, 3), np.float32)
        total, done = sum(region.pixels for region in regions), 0
        part_px = _FIRST_PATHS // self._scene.cycles.samples
        for region in regions:
            rest: Region | None = region
            while rest is not None:
                yield Progress(done, total, label)
                part, rest = rest.split(part_px)
                begun = self.seconds
                canvas[part.slices] = self.picture(part)
                part_px = max(1, int(part.pixels * _PART_S / max(self.seconds - begun, 1e-3)))
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
    """Renders of the scene, which is as before after the block. Raises SceneError if Cycles is not there.

    sun: with a sun and a sky of ours, in the copy of the scene only.
    """
    with tempfile.TemporaryDirectory(prefix="patchnet-") as folder:
        path = Path(folder) / "region.exr"
        with prepared(context, camera, samples, seed, path) as (scene, layer):
            add_passes(layer)
            with daylight(scene) if sun else nullcontext():
                scene.render.use_persistent_data = True
                try:
                    yield RegionRenders(scene, path, camera, light)
                finally:
                    scene.render.use_persistent_data = (
                        False  # now Cycles drops what it kept, before anything is removed
                    )
