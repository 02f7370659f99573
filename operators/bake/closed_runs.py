# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed pieces of placed meshes, found once a mesh."""

from __future__ import annotations

import numpy as np

from ..scene.local_mesh import LocalMesh
from ..scene.scene_mesh import Run


class ClosedPieces:
    """Remembers for each mesh which of its triangles belong to closed pieces."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[LocalMesh, np.ndarray]] = {}

    def of(self, run: Run) -> np.ndarray:
        """(N,) bool for the triangles of a run."""
        from ...patchnet_addon.light.closed import closed_triangles

        mesh = run.placements.mesh
        if id(mesh) not in self._known:
            self._known[id(mesh)] = mesh, closed_triangles(mesh.vertices, mesh.triangles)
        return np.tile(self._known[id(mesh)][1][run.first : run.last], run.hi - run.lo)
