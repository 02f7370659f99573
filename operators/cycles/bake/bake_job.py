# SPDX-License-Identifier: GPL-3.0-or-later
"""Input of a bake, and the surfels that are chosen for it (methods 7.2g)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.worker import computed, run_in_worker
from ....patchnet_addon.surface.scene_mesh import SceneMesh
from ....patchnet_addon.tracing.camera import Camera
from ...schema.values import AUTO, SEEN_CELLS
from ...settings.groups import LightSettings
from .baked_colors import ColoredLeaves, color_is_baked, colored_leaves
from .one_sided import one_sided_materials
from .placed_sheets import placed_sheets

if TYPE_CHECKING:  # they bring numba, which nothing imports before it computes
    from ....patchnet_addon.light.light_cells import CellGrid, SurfelSurface
    from ....patchnet_addon.light.seen_cells import SeenCells
    from ....patchnet_addon.light.sheets import Sheets
    from ....patchnet_addon.octree.octree import Nodes
    from ....patchnet_addon.octree.voxelize import ClippedSurface
    from ....patchnet_addon.surface.textures import TextureTable

_LOOKING = Progress(0, 1, "Looking where cameras look")


@dataclass(frozen=True, eq=False)
class BakeJob:
    """Input of a bake.

    clipped: the surface in its leaves. cameras: those that decide which light cells are fine; without any, all are.
    lookahead: levels, of the weights in use. light: `max_samples` and `noise_threshold` bound the paths of a surfel,
    `denoise` filters light over cells, `color` keeps its colour, `gloss` selects the materials whose reflections are
    baked, `daylight` replaces the scene's world by our sun and sky. device: AUTO, CPU or GPU; automatic is a GPU if the
    preferences of Cycles enable one. state: identity of the scene's state, under which surfels are kept on disk; "" for
    none.
    """

    context: bpy.types.Context
    source: SceneMesh
    clipped: ClippedSurface
    cameras: tuple[Camera, ...]
    light: LightSettings
    lookahead: int
    device: str = AUTO
    state: str = ""


@dataclass(frozen=True, eq=False)
class ChosenSurfels:
    """Surfels (N,) SURFEL with their surface and sheets, what cameras see, and the share of leaves that they do.

    has_baked_color: (M,) bool, materials of which `colored` leaves are baked; None if there are none. glows: (M,) bool,
    those whose base colors are emission.
    """

    surfels: np.ndarray
    surface: SurfelSurface
    grid: CellGrid
    sheets: Sheets
    seen: SeenCells
    nodes: Nodes
    table: TextureTable
    reflects: np.ndarray
    through: np.ndarray
    fine: float
    has_baked_color: np.ndarray
    colored: ColoredLeaves | None
    glows: np.ndarray


def choose(job: BakeJob) -> Steps[ChosenSurfels]:
    """Choose the surfels of a job."""
    from ....patchnet_addon.light.light_cells import CellGrid, reflecting, surface_of_surfels
    from ....patchnet_addon.light.seen_cells import all_cells, seen_cells
    from ....patchnet_addon.light.surfels import choose_surfels, eyes_of
    from ....patchnet_addon.lod.fit import leaves_of
    from ....patchnet_addon.surface.shading import opacity_shade

    source, clipped, light = job.source, job.clipped, job.light
    cameras = job.cameras if light.cells == SEEN_CELLS else ()
    table = yield from computed(lambda: clipped.table, Progress(0, 1, "Reading textures"))
    opacity = opacity_shade(source, table)
    leaves = yield from run_in_worker(lambda: leaves_of(clipped, opacity), _LOOKING)
    if cameras:
        looking = partial(seen_cells, leaves.nodes, clipped.grid, cameras, lookahead=job.lookahead)
        seen = yield from run_in_worker(looking, _LOOKING)
    else:
        seen = yield from computed(lambda: all_cells(leaves.keys), _LOOKING)
    through = ~one_sided_materials(source)
    sorting = partial(placed_sheets, source, job.cameras, through)
    sheets = yield from computed(sorting, Progress(0, 1, "Inspecting sheets"))
    surfels = yield from run_in_worker(
        lambda: choose_surfels(clipped, opacity, sheets, seen, eyes_of(cameras)), Progress(0, 1, "Choosing surfels")
    )

    reflects = reflecting(table, [material.base_is_known for material in source.materials])
    baked = color_is_baked(source, light.gloss)
    surfaces = partial(surface_of_surfels, surfels, source, table, reflects, color=light.color)
    at = yield from computed(surfaces, Progress(0, 1, "Choosing surfels"))
    even = [
        each.base_is_known and each.base_texture is None and max(each.base_color) > 0.0 for each in source.materials
    ]
    glows = np.array([each.glows for each in source.materials], bool)
    # Emission has no noise, and may be black beside white; what reflects beside it has, if it is of one color.
    at = at._replace(is_filtered=((reflects & ~glows) | baked | np.array(even, bool))[at.material])
    colored = None
    if baked[at.material].any():
        colored = yield from colored_leaves(clipped, opacity, sheets, seen, eyes_of(cameras), baked)
    cells = partial(CellGrid, surfels, at, clipped.grid, filtered=light.denoise)
    grid = yield from computed(cells, Progress(0, 1, "Filtering light"))
    fine = len(seen.cells) / max(sum(len(keys) for keys in leaves.keys.values()), 1)
    return ChosenSurfels(
        surfels, at, grid, sheets, seen, leaves.nodes, table, reflects, through, min(fine, 1.0), baked, colored, glows
    )
