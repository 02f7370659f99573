# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths per second of a bake, and of camera renders of the same scene in the same minutes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.lightmap.charts import Charts
from ...patchnet_addon.runtime.interrupt import interrupts_wait
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.bake.baker import Baker, lift_world
from ..cycles.bake.two_sided_surfaces import plan_sides
from ..cycles.scene_copy import prepared
from ..scene.scene_mesh import SceneMesh
from ..settings.groups import LightSettings

_MIN_PX, _MAX_PX = 64, 2048


@dataclass(frozen=True)
class Turn:
    """Page that was baked, or a picture: paths, and processor and wall seconds of the whole call."""

    paths: int
    processor_s: float
    wall_s: float


@dataclass(frozen=True)
class Rates:
    """Cost of pages, and of the render after each of them, reading the scene included."""

    pages: tuple[Turn, ...]
    renders: tuple[Turn, ...]


def rate(turns: Sequence[Turn]) -> float:
    """Paths per processor second, of all cores together: other programs' load changes it least."""
    return sum(turn.paths for turn in turns) / sum(turn.processor_s for turn in turns)


def measure_rates(
    context: bpy.types.Context, source: SceneMesh, charts: Charts, cameras: Sequence[Camera], seed: int = 0
) -> Steps[Rates]:
    """Bake each page with something on it, and render about as many paths through one camera after the other."""
    light = LightSettings(color=False)
    plan = yield from plan_sides(context, source, cameras, light, lift_world(source, charts))
    baker = Baker(context, source, charts, light, plan, seed=seed)
    pages: list[Turn] = []
    renders: list[Turn] = []
    for page in range(charts.page_count):
        yield Progress(page, charts.page_count, "Measuring")
        clock = _Clock()
        drain(baker.page(page))
        if not baker.paths_traced:
            continue
        pages.append(clock.turn(baker.paths_traced))
        samples = int(charts.page_samples[page])
        camera = _with_pixels(cameras[len(renders) % len(cameras)], baker.paths_traced / samples)
        with prepared(context, camera, samples, page, Path()) as (scene, _):
            clock = _Clock()
            with interrupts_wait():
                bpy.ops.render.render(scene=scene.name)
            renders.append(clock.turn(camera.width_px * camera.height_px * samples))
    return Rates(tuple(pages), tuple(renders))


class _Clock:
    """Clock that measures from now on."""

    def __init__(self) -> None:
        self._wall, self._processor = time.perf_counter(), time.process_time()

    def turn(self, paths: int) -> Turn:
        return Turn(paths, time.process_time() - self._processor, time.perf_counter() - self._wall)


def _with_pixels(camera: Camera, pixels: float) -> Camera:
    """Camera with a square picture of about so many pixels."""
    side = int(np.clip(round(float(np.sqrt(pixels))), _MIN_PX, _MAX_PX))
    target = camera.position_world + camera.forward
    return Camera.look_at(
        camera.position_world, target, fov=2.0 * float(np.arctan(camera.half_y)), size_px=(side, side), name=camera.name
    )
