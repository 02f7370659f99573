# SPDX-License-Identifier: GPL-3.0-or-later
"""Progressive preview of one view of a 3D viewport, refined in slices of time; drawing is elsewhere."""

from __future__ import annotations

import time

import numpy as np

from ...patchnet_addon.image.background import BLACK
from ...patchnet_addon.image.cube_map import CubeMap, pixel_directions
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.worker import attended, computed
from ...patchnet_addon.sampling.adaptive import AdaptivePicture, Pace
from .passes import combined

SLICE_S = 0.04  # least work per redraw
LONGEST_SLICE_S = 0.2  # if a redraw takes as long
COARSE = 4  # side of the first picture's squares, in pixels
_QUICK_SIDE, _FINE_SIDE = 4, 32  # rays per pixel side of the first and the second pass over the budget
_PACE = Pace(1 << 14, 1 << 17)  # a hundredth of a second each on two cores; larger steps save nothing


class ViewportPreview:
    """Coarse picture, then one ray per pixel, then equally many in all or refinement by priority within the budget.

    status: current work. done: no work is left. steps: the work, for callers that run it without `work`.
    """

    def __init__(
        self,
        picture: AdaptivePicture,
        budget: float,
        world: np.ndarray | CubeMap | None,
        spp: float | None = None,
        refined: float = _FINE_SIDE**2,
        even_side: int = _QUICK_SIDE,
    ) -> None:
        """Prepare for a picture. world: background, one colour (3,) or light by direction; None: transparent.

        spp: mean samples per active pixel instead of the share `budget`.

        refined: mean samples of the pixels in that share. even_side: rays per pixel side of a picture without a
        strategy.
        """
        self.picture = picture
        self.status = ""
        self.done = False
        self._map = world if isinstance(world, CubeMap) else None
        self._world = BLACK if isinstance(world, CubeMap) else world
        self._budget, self._spp, self._refined, self._even_side = budget, spp, refined, even_side
        self.steps = self._all()

    def show_world(self, world: np.ndarray | CubeMap | None) -> None:
        """Replace the background; traced and refined pixels stay. world: as for the constructor."""
        self._map = world if isinstance(world, CubeMap) else None
        if not isinstance(world, CubeMap):  # the former one is shown until the map is sampled
            self._world = world
        self.steps, self.done = self._look_first(self.steps), False

    def work(self, seconds: float) -> None:
        """Work for a slice of time, at least one step; raises PatchNetError."""
        end = time.perf_counter() + min(max(seconds, SLICE_S), LONGEST_SLICE_S)
        while not self.done:
            try:
                with attended():  # work without a pace runs beside the window
                    report = next(self.steps)
            except StopIteration:
                self.done, self.status = True, "Done"
                return
            self.status = f"{report.label} {round(100 * report.fraction)} %"
            if time.perf_counter() >= end:
                return

    def pixels(self) -> np.ndarray:
        """(H, W, 4) float32, scene-linear and premultiplied by alpha, row 0 at the bottom."""
        camera = self.picture.camera
        return combined(self.picture, self._world).reshape(camera.height_px, camera.width_px, 4)

    def _all(self) -> Steps[None]:
        yield Progress(0, 1, "Tracing")
        self._trace_coarsely()
        yield Progress(0, 1, "Tracing the preview")
        yield from self._look()
        yield from self.picture.trace(_PACE)
        if self.picture.strategy is None:
            yield from self.picture.sample_evenly(self._even_side, _PACE)
            return
        for side in (_QUICK_SIDE, _FINE_SIDE):
            yield from self.picture.refine(self._budget, side, _PACE, spp=self._spp, refined=self._refined)

    def _look_first(self, others: Steps[None]) -> Steps[None]:
        yield from self._look()
        yield from others

    def _look(self) -> Steps[None]:
        """Sample the map of the world for each pixel, if there is one."""
        known, looking = self._map, Progress(0, 1, "Sampling the world")
        if known is not None:
            self._world = yield from computed(lambda: known.look(pixel_directions(self.picture.camera)), looking)

    def _trace_coarsely(self) -> None:
        """Fill the picture with large squares of single rays; `samples` stays 0."""
        from ...patchnet_addon.tracing.render import first_hits, seen_above_white, seen_color

        picture, camera = self.picture, self.picture.camera
        columns, rows = (-(-side // COARSE) for side in (camera.width_px, camera.height_px))
        hits = first_hits(picture.octree, camera.with_size(columns, rows))
        column = np.arange(camera.width_px) * columns // camera.width_px
        row = np.arange(camera.height_px) * rows // camera.height_px
        square = (row[:, None] * columns + column).ravel()
        if self._map is not None:
            self._world = self._map.look(pixel_directions(camera.with_size(columns, rows)))[square]
        seen = seen_color(picture.octree, hits.node, hits.direction) + seen_above_white(picture.octree, hits)
        picture.colors[:] = seen[square]
        picture.alpha[:] = hits.hit[square]
