# SPDX-License-Identifier: GPL-3.0-or-later
"""Coarse octree of a surface, and look-ahead expected from it at a given depth (methods 4.1b)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..cells.contract import fitting_level_of
from ..octree.build import build_octree
from ..octree.grid import Grid
from ..octree.octree import Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.progress import Steps
from ..surface.mesh import Fragments, MeshSource, Shading, TriangleBatch
from ..tracing.camera import Camera
from ..tracing.render import first_hits

COARSE_DEPTH = 7


def coarse_octree(
    source: MeshSource, depth: int = COARSE_DEPTH, bounds_world: np.ndarray | None = None
) -> Steps[Octree]:
    """Build a coarse octree without light, for the position of the surface; around `bounds_world` (2, 3), or its own
    bounds.
    """
    bounds_world = source.bounds_world if bounds_world is None else bounds_world
    return (yield from build_octree(source, Grid.around(bounds_world, depth), _no_shade, exposure=1.0))


def _no_shade(_batch: TriangleBatch, fragments: Fragments) -> Shading:
    return Shading(np.zeros(len(fragments), np.float32), np.ones(len(fragments), np.float32))


def stop_levels(coarse: Octree, camera: Camera) -> np.ndarray:
    """(n,) level at which each hit pixel's ray stops in an octree of sufficient depth."""
    hits = first_hits(coarse, camera)
    z = hits.z_world[hits.hit]
    # The coarse voxel may extend up to its diagonal before the surface: assume the nearest surface.
    return fitting_level_of(camera.pixel_side(np.maximum(z, 1e-9)) / coarse.grid.side_world)


def expected_share(
    coarse: Octree, cameras: Sequence[Camera], depth: int, *, lookahead: int = DEFAULT_LOOKAHEAD
) -> float | None:
    """Expected share of hit pixels with look-ahead at a depth, in the camera with the smallest share; None without
    hits.
    """
    shares = [np.mean(stop + lookahead <= depth) for camera in cameras if len(stop := stop_levels(coarse, camera))]
    return float(min(shares)) if shares else None
