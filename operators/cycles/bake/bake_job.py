# SPDX-License-Identifier: GPL-3.0-or-later
"""Input of a bake, and its begin by the choice of its surfels (methods 7.2g)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....patchnet_addon.light.light_bake import BakePlan, BegunBake, begin_bake
from ....patchnet_addon.octree.grid import Grid
from ....patchnet_addon.process.computed import computed
from ....patchnet_addon.process.transfer import Remote
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.surface.scene_mesh import SceneMesh
from ....patchnet_addon.tracing.camera import Camera
from ...schema.values import SEEN_CELLS
from ...settings.groups import LightSettings
from .baked_colors import color_is_baked
from .one_sided import one_sided_materials

if TYPE_CHECKING:  # it brings numba, which only the engine imports
    from ....patchnet_addon.octree.voxelize import ClippedSurface


@dataclass(frozen=True, eq=False)
class BakeJob:
    """Input of a bake.

    clipped: the surface in its leaves. grid: of these. cameras: those that decide which light cells are fine; without
    any, all are. lookahead: levels, of the weights in use. light: `max_samples` and `noise_threshold` bound the paths
    of a surfel, `denoise` filters light over cells, `color` keeps its colour, `gloss` selects the materials whose
    reflections are baked, `daylight` replaces the scene's world by our sun and sky, `device` is AUTO, CPU or GPU;
    automatic is a GPU if the preferences of Cycles enable one. state: identity of the scene's state, under which
    surfels are kept on disk; "" for none.
    """

    context: bpy.types.Context
    source: SceneMesh
    clipped: Remote[ClippedSurface]
    grid: Grid
    cameras: tuple[Camera, ...]
    light: LightSettings
    lookahead: int
    state: str = ""


def begin(job: BakeJob, kept: tuple[Path, str] | None = None) -> Steps[BegunBake]:
    """Choose the surfels of a job. kept: folder of bakes and key of the light that is kept on disk; None for none."""
    source, light = job.source, job.light
    plan = BakePlan(
        cameras=job.cameras,
        cells_by_cameras=light.cells == SEEN_CELLS,
        lookahead=job.lookahead,
        color=light.color,
        denoise=light.denoise,
        noise_threshold=light.noise_threshold,
        max_samples=light.max_samples,
        through=~one_sided_materials(source),
        has_baked_color=color_is_baked(source, light.gloss),
        kept=kept,
    )
    return (yield from computed(begin_bake, source, job.clipped, plan, at=Progress(0, 1, "Reading textures")))
