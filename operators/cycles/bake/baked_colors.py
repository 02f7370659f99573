# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colours that only Cycles knows, such as those of procedural textures: baked, finer than light is.

Light over base colour varies slowly, so that light cells may be larger than leaves, and filtered; colours do not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.worker import computed, run_in_worker
from ....patchnet_addon.surface.scene_mesh import SceneMesh
from .gloss_passes import baked_with_gloss
from .one_sided import is_opaque, translucent_materials

if TYPE_CHECKING:  # they bring numba, which nothing imports before it computes
    from ....patchnet_addon.light.light_cells import CellGrid
    from ....patchnet_addon.light.seen_cells import SeenCells
    from ....patchnet_addon.light.sheets import Sheets
    from ....patchnet_addon.octree.voxelize import ClippedSurface
    from ....patchnet_addon.surface.mesh import Fragments, Shading, ShadingFn, TriangleBatch

_CHOOSING = Progress(0, 1, "Choosing surfels")


class ColoredLeaves(NamedTuple):
    """Surfels (L,) SURFEL of leaves, whose colours are baked, and the grid of their cells."""

    surfels: np.ndarray
    grid: CellGrid


def color_is_baked(source: SceneMesh, gloss: str) -> np.ndarray:
    """(M,) bool: opaque materials with diffuse light alone, in proportion to a base colour that is not known."""
    plain = [
        is_opaque(material) and not material.base_is_known and max(material.emission) <= 0.0
        for material in source.materials
    ]
    return np.array(plain, bool) & ~translucent_materials(source) & ~baked_with_gloss(source, gloss)


def colored_leaves(
    clipped: ClippedSurface, opacity: ShadingFn, sheets: Sheets, seen: SeenCells, eyes: np.ndarray, which: np.ndarray
) -> Steps[ColoredLeaves]:
    """Choose surfels in voxels that cameras see, on materials `which` (M,); elsewhere they are as coarse as light."""
    from ....patchnet_addon.light.light_cells import CellGrid, surface_of_surfels
    from ....patchnet_addon.light.surfels import choose_surfels

    def shown(batch: TriangleBatch, fragments: Fragments) -> Shading:
        shading = opacity(batch, fragments)
        return shading._replace(opacity=shading.opacity * which[batch.materials[fragments.triangle]])

    steps = choose_surfels(clipped, shown, sheets, seen, eyes, is_color=True)
    surfels = yield from run_in_worker(lambda: steps, _CHOOSING)

    def grid() -> CellGrid:
        known = np.zeros(len(which), bool)
        surface = surface_of_surfels(surfels, clipped.source, clipped.table, known, color=False)
        return CellGrid(surfels, surface, clipped.grid, filtered=False)

    return ColoredLeaves(surfels, (yield from computed(grid, _CHOOSING)))
