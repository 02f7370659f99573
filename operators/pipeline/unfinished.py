# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished pictures of a view while a job works: the first rays, the heatmap, the refinement as it goes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...patchnet_addon.image.background import BLACK, encoded, opaque
from ...patchnet_addon.image.contact_sheet import contact_sheet
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import Progress, Steps, changed
from ...patchnet_addon.runtime.worker import computed
from ...patchnet_addon.tracing.camera import Camera
from ..scene.scene_mesh import SceneMesh
from ..schema.table import TWO_LIGHTS
from ..settings.job_settings import JobSettings
from .stages import GridChoice, build, two_lights

if TYPE_CHECKING:
    from ...patchnet_addon.sampling.refined_picture import RefinedPicture

STAND_IN_DEPTH = 8  # at most, of the voxels that stand in for those whose light is not there yet
_SHOWN_S = 1.0  # between two looks at a picture that is being refined
STAND_IN = "two lights, until baked"


@dataclass(frozen=True, eq=False)
class Unfinished:
    """Picture (h, w, 3), encoded colours, of what is there of a camera's view; title: what it is, and what it lacks."""

    camera: str
    title: str
    picture: np.ndarray

    def page(self) -> np.ndarray:
        """(H, W, 3): the picture under its titles, so that nobody takes it for the result."""
        return contact_sheet([[self.picture]], [self.camera], [self.title])


Meanwhile = Callable[[Unfinished], None]  # shows one, at once


@dataclass(frozen=True, eq=False)
class Ground:
    """What a camera's picture is laid over: see `View` for the background, and the exposure of light."""

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
    """Trace the first ray of every pixel, and show it under a title over a background, see `View`."""
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
    """Show a camera's view before its light is baked: coarse voxels in the light of two lamps without shadows.

    That takes no longer than coarse voxels do, and says which objects and which camera it is that Cycles bakes for.
    """
    grid = Grid.around(settings.surface.bounds_world(source), min(choice.grid.depth, STAND_IN_DEPTH))
    shade = yield from two_lights(source, settings.light)
    octree = yield from build(source, GridChoice(grid), shade, settings.changed(exposure=None), TWO_LIGHTS, {})
    yield from first_look(octree, camera, meanwhile, STAND_IN)


def shown_meanwhile(
    steps: Steps[RefinedPicture], begun: list[RefinedPicture], ground: Ground, meanwhile: Meanwhile
) -> Steps[RefinedPicture]:
    """Pass on the steps of a refinement; now and then the picture that they work on, once it has `begun`, is shown."""
    last = time.monotonic()

    def shown(report: Progress) -> Progress:
        nonlocal last
        if begun and time.monotonic() - last > _SHOWN_S:
            light = begun[0].luminance if begun[0].colors is None else begun[0].colors
            picture = opaque(ground.picture(light, begun[0].alpha))
            meanwhile(Unfinished(ground.camera.name, f"refining, {report.fraction:.0%}", picture))
            last = time.monotonic()
        return report

    return changed(steps, shown)
