# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths per second of a bake, and of camera renders of the same scene in the same minutes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ...patchnet_addon.light.charts import Charts
from ...patchnet_addon.progress import Progress, Steps, drain
from ...patchnet_addon.tracing.camera import Camera
from ..bake.baker import Baker
from ..scene.scene_mesh import SceneMesh
from .reference import camera_render_seconds

_LEAST_PX, _MOST_PX = 64, 2048


@dataclass(frozen=True)
class Rates:
    """What both took, in turns: paths and wall seconds of whole calls, reading the scene included.

    turns: paths and seconds of a page, paths and seconds of the render after it.
    """

    turns: tuple[tuple[int, float, int, float], ...]

    @property
    def bake(self) -> float:
        """Paths per second of the bake."""
        return sum(turn[0] for turn in self.turns) / sum(turn[1] for turn in self.turns)

    @property
    def render(self) -> float:
        """Paths per second of the renders."""
        return sum(turn[2] for turn in self.turns) / sum(turn[3] for turn in self.turns)


def measure_rates(
    context: bpy.types.Context, source: SceneMesh, charts: Charts, cameras: Sequence[Camera], seed: int = 0
) -> Steps[Rates]:
    """Bake each page with something on it, and render about as many paths through one camera after the other."""
    baker = Baker(context, source, charts, seed)
    turns: list[tuple[int, float, int, float]] = []
    for page in range(charts.page_count):
        yield Progress(page, charts.page_count, "Measuring")
        start = time.perf_counter()
        drain(baker.page(page))
        seconds = time.perf_counter() - start
        if not baker.paths_traced:
            continue
        samples = int(charts.page_samples[page])
        camera = _with_pixels(cameras[len(turns) % len(cameras)], baker.paths_traced / samples)
        rendered = camera.width_px * camera.height_px * samples
        turns.append((baker.paths_traced, seconds, rendered, camera_render_seconds(context, camera, samples, page)))
    return Rates(tuple(turns))


def _with_pixels(camera: Camera, pixels: float) -> Camera:
    """The camera with a square picture of about so many pixels."""
    side = int(np.clip(round(float(np.sqrt(pixels))), _LEAST_PX, _MOST_PX))
    target = camera.position_world + camera.forward
    return Camera.look_at(
        camera.position_world, target, fov=2.0 * float(np.arctan(camera.half_y)), size_px=(side, side), name=camera.name
    )
