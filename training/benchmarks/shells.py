# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree of a given size without a scene: nested bumpy spheres, voxelized like any surface."""

from __future__ import annotations

import math

import numpy as np

from ...patchnet_addon.octree.build import build_octree
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.surface.mesh import TriangleMesh
from ...patchnet_addon.surface.shading import two_lights_shade
from ..bounds import NODES

MIN_SHELL_DEPTH = 7
_STEP = 0.06  # distance of shells, as a share of the outermost radius
_ROWS = 96


def octree_of_shells(nodes: int) -> Octree:
    """Octree of about `nodes` nodes, lit by two lights; below 100,000 nodes up to four times as many.

    Deterministic. Raises SettingError for numbers of nodes outside their bounds.
    """
    NODES.check(nodes, "--nodes")
    wanted = 1.03 * nodes
    depth = int(math.log(max(wanted / sphere_nodes(0), 1.0), 4))
    if depth < MIN_SHELL_DEPTH:  # shells that would share voxels
        return _voxelized([1.0], max(depth + 1, 1))
    while (octree := _voxelized(shell_radii(wanted / sphere_nodes(depth)), depth)).node_count < nodes:
        wanted *= 1.03
    return octree


def sphere_nodes(depth: int) -> float:
    """Estimate nodes of a sphere that fills the cube: 1.5 leaves per leaf face of its area, a third as many above."""
    return math.pi * 4.0**depth * 1.5 * 4 / 3


def shell_radii(area: float) -> list[float]:
    """Radii of nested spheres, the first 1, whose squares sum to `area` if it is above 1."""
    radii = [1.0]
    left = area - 1.0
    while left > 0 and radii[-1] > 2 * _STEP:
        radii.append(min(radii[-1] - _STEP, math.sqrt(left)))
        left -= radii[-1] ** 2
    return radii


def _voxelized(radii: list[float], depth: int) -> Octree:
    mesh = TriangleMesh.from_arrays(np.concatenate([shell_triangles(radius) for radius in radii]))
    grid = Grid.around(mesh.bounds_world, depth)
    provenance = {"scene": "shells", "radii": radii}
    return drain(build_octree(mesh, grid, two_lights_shade(mesh), exposure=1.0, provenance=provenance))


def shell_triangles(radius: float, rows: int = _ROWS) -> np.ndarray:
    """Triangles (T, 3, 3) float64 of a closed sphere with bumps of 2 %, 2 * rows columns around its axis."""
    polar, around = np.meshgrid(
        np.linspace(0, math.pi, rows + 1), np.linspace(0, 2 * math.pi, 2 * rows + 1), indexing="ij"
    )
    bumpy = radius * (1.0 - 0.01 * (1.0 + np.sin(9 * polar) ** 2 * np.cos(8 * around)))
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    points *= bumpy[..., None]  # (rows + 1, 2 rows + 1, 3)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)
