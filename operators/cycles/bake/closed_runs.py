# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed pieces of placed meshes, found once a mesh."""

from __future__ import annotations

import numpy as np

from ...scene.local_mesh import LocalMesh
from ...scene.scene_mesh import MeshInstances, Run


class ClosedPieces:
    """Closed pieces: remembers for each mesh which triangles belong to which, and numbers them in all places."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[LocalMesh, np.ndarray]] = {}
        self._first: dict[int, tuple[MeshInstances, int]] = {}
        self._count = 0

    def of(self, run: Run) -> np.ndarray:
        """(N,) int64 for the triangles of a run: the number of the closed piece, different in each place; -1: open."""
        from ....patchnet_addon.surface.connected import closed_pieces

        places, mesh = run.instances, run.instances.mesh
        if id(mesh) not in self._known:
            self._known[id(mesh)] = mesh, closed_pieces(mesh.vertices, mesh.triangles)
        if id(places) not in self._first:
            self._first[id(places)] = places, self._count
            self._count += places.triangle_count
        pieces = self._known[id(mesh)][1][run.first : run.last].astype(np.int64)
        first = self._first[id(places)][1] + np.arange(run.lo, run.hi, dtype=np.int64)[:, None] * len(mesh)
        return np.where(pieces < 0, -1, pieces + first).reshape(-1)
