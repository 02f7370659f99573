# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished pictures of a view while a job works: the preview, the heatmap, the refinement in progress."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...patchnet_addon.image.background import BLACK, encoded, opaque
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import Progress, Steps, changed
from ...patchnet_addon.runtime.worker import computed
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera
from ..schema.values import BOX_SHAPE, TWO_LIGHTS
from ..settings.job_settings import JobSettings
from .stages import GridChoice, build, two_lights

if TYPE_CHECKING:
    from ...patchnet_addon.sampling.refined_picture import RefinedPicture

STAND_IN_DEPTH = 8  # largest depth of the voxels that are shown before the bake
_SHOWN_S = 1.0  # between two updates of a picture in refinement
STAND_IN = "two lights, until baked"


@dataclass(frozen=True, eq=False)
class Unfinished:
    """Unfinished picture (h, w, 3) of a camera's view, encoded colours, with a title."""

    camera: str
    title: str
    picture: np.ndarray


Meanwhile = Callable[[Unfinished], None]  # shows a picture at once


@dataclass(frozen=True, eq=False)
class Ground:
    """Background and exposure of a camera's picture, see `View`."""

    camera: Camera
    background: np.ndarray | None
    exposure: float

    def picture(self, light: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """(H, W, 3) encoded colours of light (P,) or (P, 3) weighed by alpha (P,), or (H, W, 4) without background."""
        pixels = encoded(light, alpha, self.background, self.exposure)
        return pixels.reshape(self.camera.height_px, self.camera.width_px, -1)


def first_look(
    octree: Octree,
    camera: Camera,
    meanwhile: Meanwhile,
    title: str = "preview",
    *,
    background: np.ndarray | None = BLACK,
) -> Steps[None]:
    """Trace the first ray of every pixel, and show the picture with a title over a background, see `View`."""
    from ...patchnet_addon.tracing.render import first_hits, seen_color

    ground = Ground(camera, background, octree.exposure)

    def traced() -> np.ndarray:
        hits = first_hits(octree, camera)
        light = hits.luminance if octree.chroma is None else seen_color(octree, hits.node, hits.direction)
        return opaque(ground.picture(light, hits.hit.astype(np.float32)))

    picture = yield from computed(traced, Progress(0, 1, f"{camera.name}: Tracing the preview"))
    meanwhile(Unfinished(camera.name, title, picture))


def stand_in_look(
    source: SceneMesh, choice: GridChoice, settings: JobSettings, camera: Camera, meanwhile: Meanwhile
) -> Steps[None]:
    """Show a camera's view before the bake: coarse voxels in two lights without shadows.

    It is fast, and shows the objects and the camera of the bake.
    """
    from ...patchnet_addon.octree.voxelize import ClippedSurface

    grid = Grid.around(settings.surface.bounds_world(source), min(choice.grid.depth, STAND_IN_DEPTH))
    lit = yield from two_lights(source, settings.light)
    clipped = yield from computed(lambda: ClippedSurface(source, grid, keep_bytes=0), Progress(0, 1, "Voxelizing"))
    octree = yield from build(clipped, lit, settings.changed(exposure=None, shape=BOX_SHAPE), TWO_LIGHTS, {})
    yield from first_look(octree, camera, meanwhile, STAND_IN)


def shown_meanwhile(
    steps: Steps[RefinedPicture], begun: list[RefinedPicture], ground: Ground, meanwhile: Meanwhile
) -> Steps[RefinedPicture]:
    """Show the picture of a refinement from time to time, once it has `begun`."""
    last = time.monotonic()

    def shown(report: Progress) -> Progress:
        nonlocal last
        if begun and time.monotonic() - last > _SHOWN_S:
            picture = opaque(ground.picture(begun[0].colors, begun[0].alpha))
            meanwhile(Unfinished(ground.camera.name, f"refining, {report.fraction:.0%}", picture))
            last = time.monotonic()
        return report

    return changed(steps, shown)
