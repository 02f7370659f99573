# SPDX-License-Identifier: GPL-3.0-or-later
"""What tests read of a bake, in the process that computes: baked light of all fragments, and surfels."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.light.light_bake import LightBake
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.process.transfer import Remote
from patchnet.patchnet_addon.surface.light import SurfaceLight
from patchnet.patchnet_addon.surface.scene_mesh import SceneMesh
from patchnet.tests.references.clip import centroids, parts_of


def clip_evenly(source: SceneMesh, grid: Grid, color: bool) -> Remote[ClippedSurface]:
    """Cut a surface into leaves of one level."""
    return Remote(ClippedSurface(source, grid, color=color))


def read_fragments(clipped: ClippedSurface, light: SurfaceLight) -> tuple[np.ndarray, ...]:
    """Light of F fragments, as the octree takes it: triangles (F,) of the surface, places (F, 3) and areas (F,) in the
    world, luminance and opacity (F,), and luminance (F, 2) of front and back.
    """
    parts = []
    for batch, fragments in parts_of(clipped):
        place = centroids(batch.corners_world, fragments)
        luminance, opacity, _, lights, _ = light.shade(batch, fragments)
        triangle = fragments.triangle + batch.first_triangle
        parts.append((triangle, place, fragments.area_world, luminance, opacity, lights[..., 0]))
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def read_surfels(bake: LightBake) -> tuple[np.ndarray, np.ndarray]:
    """All surfels of a bake."""
    return bake.chosen.surfels, bake.chosen.surface.place
