# SPDX-License-Identifier: GPL-3.0-or-later
"""Progressive preview of one view of a 3D viewport, which the engine works on; drawing is elsewhere."""

from __future__ import annotations

import time

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.live_picture import LivePixels, World, fill_background, live_picture, show_again
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.adaptive import PictureSettings
from ...patchnet_addon.sampling.importance import PixelRect
from ...patchnet_addon.tracing.camera import Camera
from ..importance.pixels import Strokes

_FIRST_S = 0.02  # longest wait for the first picture, so that it is that of the view
_WAIT_S = 0.015  # longest wait for a later one
_MORE_S = 0.003  # after a picture: all that has been sent meanwhile is read
_SLICE_S = 0.04  # least work per redraw where no other process works
_LONGEST_SLICE_S = 0.2  # if a redraw takes as long


class ViewportPreview:
    """Coarse picture, then one ray per pixel, then equally many in all or refinement by priority within the budget.

    pixels: None before the first picture. is_new: they may have changed since `take`. status: current work. done: no
    work is left. steps: the work, for callers that run it without `work`.
    """

    def __init__(
        self,
        octree: Octree,
        coded: CodedOctree | None,
        camera: Camera,
        wanted: PictureSettings,
        world: World,
        strokes: Strokes | None = None,
        rect: PixelRect | None = None,
    ) -> None:
        """Begin a picture. world: background. rect: area that an image of strokes is stretched over."""
        self.octree, self.camera = octree, camera
        self.pixels: LivePixels | None = None
        self.is_new = self.done = False
        self.status = ""
        self._picture = octree, coded, camera, wanted
        self._strokes, self._rect = strokes or Strokes(), rect
        self.steps = self._begun(world)

    def show_world(self, world: World) -> None:
        """Replace the background; traced and refined pixels stay, if there are some already."""
        pixels = self.pixels
        if pixels is None or pixels.values is None or (pixels.background is None) != (world is None):
            self.close()
            self.steps, self.pixels = self._begun(world), None
        elif world is not None and pixels.background is not None:
            self.steps = _over(world, pixels, self.camera, self.octree.exposure, self.steps)
        self.done = False

    def work(self, seconds: float) -> None:
        """Take what the engine has sent, and wait for more for a moment; where it is this process, work for a slice.

        seconds: of such a slice, about. Raises PatchNetError.
        """
        start = time.perf_counter()
        wait, slice_s = _WAIT_S if self.pixels else _FIRST_S, min(max(seconds, _SLICE_S), _LONGEST_SLICE_S)
        while not self.done:
            report = next(self.steps, None)
            if report is None:
                self.done, self.status, self.is_new = True, "Done", True
                return
            spent = time.perf_counter() - start
            if report.partial is not None:
                self.pixels, self.is_new = report.partial, True
                wait = min(wait, spent + _MORE_S)
            note = f", {report.note}" if report.note else ""
            self.status = f"{report.label} {round(100 * report.fraction)} %{note}"
            if spent >= (wait if report.waiting else slice_s):
                return

    def take(self) -> np.ndarray:
        """(H, W, 4) float32 to draw over the whole view, scene-linear and premultiplied by alpha, lowest row first."""
        assert self.pixels is not None
        self.is_new = False
        return self.pixels.shown

    def close(self) -> None:
        """Let the engine stop."""
        self.steps.close()

    def _begun(self, world: World) -> Steps[None]:
        importance = self._strokes.weights(self.octree.grid, self._rect)
        steps = computed(live_picture, *self._picture, importance, world, at=Progress(0, 1, "Tracing"))
        return self._strokes.answering(steps)


def _over(
    world: np.ndarray | World, pixels: LivePixels, camera: Camera, exposure: float, others: Steps[None]
) -> Steps[None]:
    """Put another background behind a picture, whose other steps go on meanwhile."""
    looking = Progress(0, 1, "Sampling the world")
    yield from computed(fill_background, pixels.background, camera, world, at=looking)
    yield from others
    yield from computed(show_again, pixels, exposure, at=looking)  # as the last picture may have had the former one
