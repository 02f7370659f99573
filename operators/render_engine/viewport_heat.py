# SPDX-License-Identifier: GPL-3.0-or-later
"""Live heatmap of one viewport on the graphics card: at half the resolution while the view moves, then in bands."""

from __future__ import annotations

import time
from typing import Any
from weakref import ReferenceType, ref

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.sampling.patchnet import LUMINANCE_WEIGHT
from ...patchnet_addon.tracing.camera import Camera, CameraUnit, camera_in_unit_cube, camera_part
from ..gpu_view.card_octree import CardOctree
from ..gpu_view.shaders import FLOATS

_RAMP = 256
_FIRST_ROWS, _FEWEST_ROWS = 32, 8  # of a band
_QUICK_S, _SLOW_S = 0.02, 0.05  # between two drawings: bands grow below, shrink above


class CardHeat:
    """Heatmap of a view; dropping it frees its images.

    shown: texture that is drawn over the view, as a screen shows it. done: it has the view's resolution.
    """

    def __init__(self) -> None:
        self.shown: Any = None
        self.done = False
        self._wanted: tuple[Any, ...] = ()
        self._pass: _Pass | None = None
        self._rows, self._last = _FIRST_ROWS, 0.0
        self._seen: tuple[ReferenceType[CodedOctree], Camera] | None = None

    def look(
        self,
        card: CardOctree,
        coded: CodedOctree,
        view: tuple[Any, ...],
        camera: Camera,
        kind: tuple[int, float],
        ramp: str,
    ) -> None:
        """Work at the heatmap of a view. kind: see `CardOctree.heat`. ramp: name of a colour map."""
        self._seen = ref(coded), camera
        now, wanted = time.perf_counter(), (view, kind, ramp)
        if wanted != self._wanted:
            self._wanted, self.done, self._pass = wanted, False, None
            half = _Pass(card, camera.with_size(max(camera.width_px // 2, 1), max(camera.height_px // 2, 1)), ramp)
            half.decode(half.camera.height_px)
            self.shown = half.heat(kind)
        elif not self.done:
            if self._pass is None:
                self._pass = _Pass(card, camera, ramp)
            elif now - self._last < _QUICK_S:
                self._rows *= 2
            elif now - self._last > _SLOW_S:
                self._rows = max(self._rows // 2, _FEWEST_ROWS)
            if self._pass.decode(self._rows):
                self.shown, self._pass, self.done = self._pass.heat(kind), None, True
        self._last = now

    def describe_pixel(self, column: int, row: int) -> list[str]:
        """Lines about a pixel of the view, which the CPU's kernels look at: nothing is read back."""
        from ...patchnet_addon.codes.predict import predict
        from ...patchnet_addon.tracing.render import first_hits

        coded, camera = (None, None) if self._seen is None else (self._seen[0](), self._seen[1])
        if coded is None or camera is None:
            return []
        hits = first_hits(coded.octree, camera_part(camera, column, row, 1, 1))
        if not hits.hit[0]:
            return [f"Pixel {column}, {row}", "Level none: background"]
        found, shown = predict(coded, hits), float(hits.luminance[0])
        coverage, luminance = float(found.coverage[0]), float(found.luminance[0])
        score = abs(1.0 - coverage) + LUMINANCE_WEIGHT * abs(shown - luminance)
        return [
            f"Pixel {column}, {row}",
            f"Priority {score:.4g}",
            f"Coverage {coverage:.3f}" + ("" if found.look_ahead[0] else ": no look-ahead"),
            f"Preview luminance {shown:.4f}",
            f"Luminance of the patch {luminance:.4f}",
            f"Level {hits.level[0]}",
        ]


class _Pass:
    """Hits of a view, and how much of it is decoded."""

    def __init__(self, card: CardOctree, camera: Camera, ramp: str) -> None:
        device, size = card.device, (camera.width_px, camera.height_px)
        self.camera: CameraUnit = camera_in_unit_cube(camera, card.grid)
        self._card, self._row = card, 0
        self._hits, self._decoded = card.hit_images(self.camera), device.image(*size, FLOATS)
        colors = np.ones((_RAMP, 4), np.float32)
        colors[:, :3] = colormap(np.linspace(0, 1, _RAMP), ramp)
        self._ramp = device.texture(colors.view(np.uint32))
        card.trace(self.camera, self._hits)

    def decode(self, rows: int) -> bool:
        """Decode some more rows; returns whether these were the last."""
        rows = min(rows, self.camera.height_px - self._row)
        self._card.decode(self.camera, self._hits, self._decoded, (self._row, rows))
        self._row += rows
        return self._row == self.camera.height_px

    def heat(self, kind: tuple[int, float]) -> Any:
        """Texture of the heatmap."""
        made = self._card.device.image(self.camera.width_px, self.camera.height_px, FLOATS)
        self._card.heat(self.camera, self._hits, self._decoded, self._ramp, kind, made)
        return made
