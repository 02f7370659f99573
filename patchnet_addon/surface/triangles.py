# SPDX-License-Identifier: GPL-3.0-or-later
"""Areas and normals of triangles."""

from __future__ import annotations

import numpy as np


def triangle_areas_and_normals(corners_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Areas (T,) and unit normals (T, 3) of triangles (T, 3, 3); degenerate ones get area 0."""
    edges = corners_world[:, 1:] - corners_world[:, :1]  # (T, 2, 3)
    cross = np.cross(edges[:, 0], edges[:, 1])
    length = np.sqrt((cross * cross).sum(axis=1))
    normals = cross / np.where(length > 0, length, 1.0)[:, None]
    return 0.5 * length, normals
