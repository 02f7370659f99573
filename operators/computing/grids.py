# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of an octree's grid and of the levels of its leaves, and what it will hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from ...patchnet_addon.lod.fitted_levels import LAYOUT_BYTES, LOOK_AHEAD_SHARE, FittedLevels
from ...patchnet_addon.lod.memory import (
    available_memory,
    check_memory,
    expected_leaves,
    max_leaves,
    peak_bytes,
    stored_bytes,
)
from ...patchnet_addon.network.weights import load_weights
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.leaf_levels import BLOCK_FRAGMENTS, LeafLevels
from ...patchnet_addon.runtime.bounds import MAX_DEPTH
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.surface.mesh import MeshSource
from ...patchnet_addon.tracing.camera import Camera
from ..settings.job_settings import JobSettings

_MORE_LEAVES = 1.15  # than a rough fit finds, which does not look through the gaps of fine leaves


@dataclass(frozen=True, eq=False)
class GridChoice:
    """Grid of the octree, the levels of its leaves (None: all on the deepest), and warnings.

    leaves: approximate number of leaves; 0 if unknown. cameras: those that it was chosen for, or that see it.
    """

    grid: Grid
    layout: LeafLevels | None = None
    warnings: tuple[str, ...] = ()
    leaves: int = 0
    cameras: Sequence[Camera] = ()


class Expected(NamedTuple):
    """Expectation of an octree: its grid, leaves with their memory, and the share of hit pixels with look-ahead.

    rough_leaves: before what a rough fit misses. fragments: see `plan_passes`. peak_bytes: of building; free_bytes:
    limit. lookahead_share: None if no camera sees anything. lookahead: levels.
    """

    grid: Grid
    leaves: int
    rough_leaves: int
    fragments: float
    octree_bytes: int
    peak_bytes: int
    free_bytes: int
    lookahead_share: float | None
    lookahead: int


def chosen_grid(source: MeshSource, cameras: Sequence[Camera], settings: JobSettings) -> Steps[GridChoice]:
    """Grid around the surface by the settings' depth or voxel size, else with leaves fitted to the cameras.

    Raises MemoryEstimateError if a given depth does not fit into memory.
    """
    make = _fitted_grid if settings.surface.is_fitted else _even_grid
    return (yield from make(source, cameras, settings))


def _even_grid(source: MeshSource, _cameras: Sequence[Camera], settings: JobSettings) -> Steps[GridChoice]:
    """Grid of a given depth or voxel size."""
    from ...patchnet_addon.lod.depth import coarse_octree

    grid = settings.surface.given_grid(source)
    bounds_world = settings.surface.bounds_world(source)
    coarse = yield from labelled(coarse_octree(source, bounds_world=bounds_world), "Finding the depth")
    leaves = expected_leaves(coarse, grid.depth)
    check_memory(leaves, grid.depth, settings.surface.memory_bytes, settings.contents)
    return GridChoice(grid, leaves=leaves)


def _fitted_grid(source: MeshSource, cameras: Sequence[Camera], settings: JobSettings) -> Steps[GridChoice]:
    """Grid with leaves as deep as the cameras need, within the memory limit."""
    grid, fitted = yield from _fitted_levels(source, cameras, settings)
    warnings: tuple[str, ...] = ()
    if fitted.lookahead_share is not None and fitted.lookahead_share < LOOK_AHEAD_SHARE:
        warnings = (
            f"The cameras need leaves down to level {fitted.wanted}, more than memory or depth allow: about "
            f"{fitted.lookahead_share:.0%} of pixels will have look-ahead; choose smaller pictures or fewer cameras",
        )
    return GridChoice(grid, fitted.layout, warnings, fitted.leaves)


def _fitted_levels(
    source: MeshSource, cameras: Sequence[Camera], settings: JobSettings, *, rough: bool = False
) -> Steps[tuple[Grid, FittedLevels]]:
    """Grid and levels of leaves for the cameras, within the memory limit; `rough`: an estimate, in less time."""
    from ...patchnet_addon.lod.fit import fit_leaf_levels
    from ...patchnet_addon.surface.shading import opacity_shade

    grid = Grid.around(settings.surface.bounds_world(source), MAX_DEPTH)
    memory = settings.surface.memory_bytes or available_memory()
    most = max_leaves(memory - LAYOUT_BYTES, settings.contents)
    lookahead, shade = load_weights(settings.network.weights).lookahead, opacity_shade(source)
    fitting = fit_leaf_levels(source, grid, cameras, shade, max_leaves=most, lookahead=lookahead, rough=rough)
    fitted = yield from fitting
    return replace(grid, depth=fitted.layout.deepest), fitted


def expected_octree(
    source: MeshSource, cameras: Sequence[Camera], fit: Sequence[Camera], settings: JobSettings
) -> Steps[Expected]:
    """Expectation of an octree for pictures through cameras; fit: those that its leaves are fitted to."""
    from ...patchnet_addon.lod.depth import coarse_octree, expected_share
    from ...patchnet_addon.octree.blocks import plan_passes

    surface, lookahead = settings.surface, load_weights(settings.network.weights).lookahead
    if surface.is_fitted:
        grid, fitted = yield from labelled(_fitted_levels(source, fit, settings, rough=True), "Estimating")
        layout, rough_leaves, share = fitted.layout, fitted.leaves, fitted.lookahead_share
        leaves = int(_MORE_LEAVES * rough_leaves)
    else:
        grid, bounds_world = surface.given_grid(source), surface.bounds_world(source)
        coarse = yield from labelled(coarse_octree(source, bounds_world=bounds_world), "Estimating")
        yield Progress(1, 2, "Estimating: what cameras see")
        layout = LeafLevels.uniform(grid.depth)
        leaves = rough_leaves = expected_leaves(coarse, grid.depth)
        share = expected_share(coarse, cameras, grid.depth, lookahead=lookahead)
    yield Progress(1, 1, "Estimating")
    return Expected(
        grid=grid,
        leaves=leaves,
        rough_leaves=rough_leaves,
        fragments=plan_passes(source, grid, layout, BLOCK_FRAGMENTS)[1],
        octree_bytes=stored_bytes(leaves, settings.contents),
        peak_bytes=peak_bytes(leaves, settings.contents),
        free_bytes=surface.memory_bytes or available_memory(),
        lookahead_share=share,
        lookahead=lookahead,
    )
