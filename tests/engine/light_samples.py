# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces with sheets, what cameras see of them, their surfels, and light that was baked on these."""

import numpy as np
from numpy.typing import ArrayLike

from patchnet.patchnet_addon.light.light_cells import SurfelSums, SurfelSurface
from patchnet.patchnet_addon.light.seen_cells import SeenCells, all_cells
from patchnet.patchnet_addon.light.sheets import Sheets
from patchnet.patchnet_addon.light.surfels import choose_surfels
from patchnet.patchnet_addon.lod.fit import leaf_keys_of
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import ShadingFn, TriangleMesh
from patchnet.patchnet_addon.surface.sides import faces_of
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals

from .mesh_samples import even, in_batches

NO_EYES = np.empty((0, 4))
FLAT_GRID = Grid((0.0, 0.0, 0.0), 1.0, 6)
THINNED = even(1.0, np.resize([1.0, 0.5, 0.003, 0.0], 60))  # shade of `random_surface`, in part below the least opacity


def random_surface(seed: int, cuts: tuple[int, ...] = (17, 40)) -> tuple[TriangleMesh, Sheets]:
    """Triangles of all sizes and of several sheets, many in one place; some of no sheet."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0.1, 0.9, (60, 1, 3)) + rng.normal(size=(60, 3, 3)) * rng.choice([0.02, 0.2], (60, 1, 1))
    corners[:20] = 0.5 + 0.06 * rng.normal(size=(20, 3, 3))
    sheet, lit = rng.integers(-1, 12, 60).astype(np.int32), rng.integers(-1, 2, 60).astype(np.int8)
    corners = np.clip(corners, 0.01, 0.99)
    return TriangleMesh(in_batches(corners, cuts)), sheets_on(corners, sheet, lit)


def sheets_on(corners: np.ndarray, sheet: ArrayLike = 0, lit: ArrayLike = 0) -> Sheets:
    """Sheets of triangles (T, 3, 3) with numbers (T,) and lit sides (T,), or one for all."""
    count, faces = len(corners), faces_of(triangle_areas_and_normals(corners)[1])
    return Sheets(np.resize(sheet, count).astype(np.int32), np.resize(lit, count).astype(np.int8), faces)


def sheet_surface(corners: np.ndarray, sheet: ArrayLike = 0, lit: ArrayLike = 0) -> tuple[TriangleMesh, Sheets]:
    """Surface of triangles (T, 3, 3) and their sheets, see `sheets_on`."""
    return TriangleMesh.from_arrays(corners), sheets_on(corners, sheet, lit)


def random_layout(seed: int) -> LeafLevels:
    """Leaves of several levels: some cells are coarse for some leaves and fine for others."""
    return LeafLevels(np.random.default_rng(seed).integers(3, 6, 64).astype(np.uint8))


def partly_seen(clipped: ClippedSurface, shade: ShadingFn, seed: int) -> SeenCells:
    """A third of the leaves, or of voxels above them, as if cameras saw them from various distances."""
    rng = np.random.default_rng(seed)
    keys = drain(leaf_keys_of(clipped, shade))
    cells = {
        (int(key) >> 3 * up) << 5 | level - up
        for level, part in keys.items()
        for key, up in zip(part, rng.integers(0, 3, len(part)), strict=True)
        if rng.random() < 1 / 3
    }
    ordered = np.array(sorted(cells), np.uint64)
    level = (ordered & np.uint64(31)).astype(np.int64) - rng.integers(-1, 3, len(ordered))
    return SeenCells(ordered, level, rng.uniform(0.1, 9.0, len(ordered)).astype(np.float32))


def surfels_of(
    source: TriangleMesh,
    sheets: Sheets,
    shade: ShadingFn | None = None,
    grid: Grid = FLAT_GRID,
    eyes: np.ndarray = NO_EYES,
    **settings: object,
) -> np.ndarray:
    """Surfels of a surface all of whose leaves are seen."""
    shade, clipped = shade or even(), ClippedSurface(source, grid, **settings)
    seen = all_cells(drain(leaf_keys_of(clipped, shade)))
    return drain(choose_surfels(clipped, shade, sheets, seen, eyes))


def plain_surface(surfels: np.ndarray, places: np.ndarray, base: float = 1.0) -> SurfelSurface:
    """Surface of surfels (N,) at places (N, 3) that faces up, of one base colour."""
    count = len(surfels)
    normal = np.tile([0.0, 0.0, 1.0], (count, 1))
    bases = np.full((count, 1), base, np.float32)
    return SurfelSurface(places, normal, bases, np.ones(count, bool), np.zeros(count, np.int32))


def sums_of(light: np.ndarray, opacity: np.ndarray | float = 1.0, samples: int = 8) -> SurfelSums:
    """Sums of surfels whose paths, in two parts, brought light (N, 2) in luminance; each through `opacity`."""
    mean, half = light.mean(axis=1) * opacity, 0.5 * (light[:, 0] - light[:, 1]) * opacity
    sums = SurfelSums.zeros(len(light), 3)
    means = np.stack([mean, np.broadcast_to(opacity, mean.shape), half], axis=1)
    sums.add(np.arange(len(light)), means, samples)
    return sums
