# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluated Blender mesh as compact arrays in its own space."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

_NORMAL_SCALE = 32767.0


@dataclass(frozen=True, eq=False)
class LocalMesh:
    """Triangles of one evaluated mesh, read once however often it is placed.

    vertices: (V, 3) float32, only those that triangles use. triangles: (T, 3) int32.
    uvs: (T, 3, 2) float32 of the layer that renders, or None. slots: (T,) int16 material slots, or None if all are 0.
    normals: (T, 3, 3) int16 shading normals, 32767 = 1, or None if all faces are flat.
    layers: further corner layers that materials name, (T, 3, C) float32: C = 1 for numbers, 2 for UV, 3 for vectors,
        4 for colours.
    origin: hash of the sources of UVs and layers, if their last bits vary between evaluations; otherwise "".
    thickness: mean diameter of the strands or points that it represents, 0 for a mesh.
    damaged: faces are left out, whose vertices are not finite numbers. turned: many normals point below the surface.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    uvs: np.ndarray | None
    slots: np.ndarray | None
    normals: np.ndarray | None
    layers: dict[str, np.ndarray] = field(default_factory=dict)
    origin: str = ""
    thickness: float = 0.0
    damaged: bool = False
    turned: bool = False

    def __len__(self) -> int:
        return len(self.triangles)

    def corner_normals(self, first: int, last: int) -> np.ndarray | None:
        """Shading normals (last - first, 3, 3) float32 of a range of triangles, or None if they are flat."""
        return None if self.normals is None else self.normals[first:last].astype(np.float32) / np.float32(_NORMAL_SCALE)


def packed_normals(normals: np.ndarray) -> np.ndarray:
    """Normals as `LocalMesh` holds them, int16."""
    normals = np.nan_to_num(np.clip(normals, -1.0, 1.0))
    return np.rint(normals * np.float32(_NORMAL_SCALE)).astype(np.int16)
