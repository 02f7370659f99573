# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain twins of what kernels say of the sides of voxels (methods 7.2i)."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.surface.chroma import REC709, decoded_colors


def seen_reference(octree: Octree, nodes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Linear colours (N, 3) float64 of nodes (N,) along directions (N, 3)."""
    colors = octree.color_float(nodes).astype(np.float64)
    for i, (node, way) in enumerate(zip(nodes.tolist(), directions.astype(np.float64), strict=True)):
        row = int(np.searchsorted(octree.side_nodes, node))
        if row == len(octree.side_nodes) or octree.side_nodes[row] != node:
            continue
        faces = [2 * axis + int(way[axis] > 0) for axis in range(3)]
        weight = np.abs(way) * octree.side_share[row, faces] / 255.0
        light = (octree.side_light[row, faces] / 255.0) ** 2
        shown = np.repeat(light[:, None], 3, axis=1)
        if octree.side_chroma is not None:
            shown = decoded_colors(light, octree.side_chroma[row, faces])
        rest = 1.0 / 255.0 + (np.abs(way).sum() - weight.sum() if octree.child_mask[node] else 0.0)
        colors[i] = (rest * colors[i] + weight @ shown) / (rest + weight.sum())
    return colors


def luminance_reference(octree: Octree, nodes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Luminance (...,) float32 of nodes (...,) along directions (..., 3)."""
    if octree.side_nodes is None:
        return octree.luminance_float(nodes)
    ways = np.broadcast_to(directions, (*nodes.shape, 3)).reshape(-1, 3)
    colors = seen_reference(octree, nodes.ravel(), ways)
    return np.asarray(colors @ REC709.astype(np.float64), np.float32).reshape(nodes.shape)


def composed_reference(children: list[int], axis: int, lower: bool, light, share, cover) -> tuple[float, float]:
    """Luminance and share that a face of a node shows of its eight children, -1 for none.

    light, share: (c, 6) of children. cover: (c, 3). All in [0, 1].
    """
    face, total, seen = 2 * axis + int(lower), 0.0, 0.0
    for octant in range(8):
        if (octant >> axis & 1 == 0) != lower:
            continue
        free = 1.0
        for child in (children[octant], children[octant ^ 1 << axis]):
            if child >= 0:
                total += free * share[child, face]
                seen += free * share[child, face] * light[child, face]
                free *= 1.0 - cover[child, axis]
    return (seen / total if total else 0.0), total / 4.0
