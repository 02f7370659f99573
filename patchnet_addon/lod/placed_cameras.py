# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras placed in and around a surface, by its coarse octree."""

from __future__ import annotations

import numpy as np

from ..octree.octree import Octree
from ..runtime.progress import Steps
from ..surface.mesh import MeshSource
from ..tracing.camera import Camera


def cameras_inside(
    surface: MeshSource | Octree, bounds_world: np.ndarray, count: int, size_px: tuple[int, int]
) -> Steps[list[Camera]]:
    """Cameras of a size inside an enclosing surface, such as a room, or its octree; none if it does not enclose."""
    from ..runtime.threads import limit_threads
    from ..tracing.viewpoints import encloses, viewpoints
    from .depth import coarse_octree

    octree = surface
    if not isinstance(octree, Octree):
        octree = yield from coarse_octree(octree, bounds_world=bounds_world)
    with limit_threads(1):  # threads cost more than they save for small pictures
        if not encloses(octree):
            return []
        return (yield from viewpoints(octree, count, size_px, lit=False))


def cameras_around(
    source: MeshSource, bounds_world: np.ndarray, depth: int, count: int, size_px: tuple[int, int]
) -> Steps[list[Camera]]:
    """Cameras placed in and around a surface, among voxels of a depth."""
    from ..tracing.viewpoints import viewpoints
    from .depth import coarse_octree

    coarse = yield from coarse_octree(source, depth, bounds_world)
    return (yield from viewpoints(coarse, count, size_px, lit=False))
