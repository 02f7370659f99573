# SPDX-License-Identifier: GPL-3.0-or-later
"""What tests read of a bake, in the process that computes: baked light of all fragments, and surfels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from patchnet.patchnet_addon.light.light_bake import LightBake
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.process.transfer import Remote
from patchnet.patchnet_addon.surface.light import SurfaceLight
from patchnet.patchnet_addon.surface.scene_mesh import SceneMesh
from patchnet.tests.references.clip import parts_of


class ReadFragments(NamedTuple):
    """Fragments (F,): triangles of the surface, places (F, 3) and areas in the world, luminance, opacity, and luminance
    (F, 2) of front and back.
    """

    triangle: np.ndarray
    place: np.ndarray
    area: np.ndarray
    luminance: np.ndarray
    opacity: np.ndarray
    sides: np.ndarray


class ReadSurfels(NamedTuple):
    """Surfels (N,) SURFEL and their places (N, 3) in the world."""

    surfels: np.ndarray
    place: np.ndarray


def clip_evenly(source: SceneMesh, grid: Grid, color: bool) -> Remote[ClippedSurface]:
    """Cut a surface into leaves of one level."""
    return Remote(ClippedSurface(source, grid, color=color))


def read_fragments(clipped: ClippedSurface, light: SurfaceLight) -> ReadFragments:
    """Light of all fragments, as the octree takes it."""
    parts = []
    for batch, fragments in parts_of(clipped):
        corners = batch.corners_world[fragments.triangle]
        weights = fragments.barycentric[..., None].astype(np.float64)
        place = corners[:, 0] + (weights * (corners[:, 1:] - corners[:, :1])).sum(axis=1)
        luminance, opacity, _, lights, _ = light.shade(batch, fragments)
        triangle = fragments.triangle + batch.first_triangle
        parts.append((triangle, place, fragments.area_world, luminance, opacity, lights[..., 0]))
    return ReadFragments(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def read_surfels(bake: LightBake) -> ReadSurfels:
    """All surfels of a bake."""
    return ReadSurfels(bake.chosen.surfels, bake.chosen.surface.place)
