# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain references of the light of voxel sides (methods 7.2i)."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.surface.chroma import REC709, decoded_colors

FRONT = 32.0  # a fragment at a voxel's near face counts e^32 times as much as one at the far face


def leaf_reference(
    area: np.ndarray, normals: np.ndarray, ends: np.ndarray, light: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """Luminance and projected area of the six faces of a leaf of a side from its fragments (F,).

    ends: (F, 3, 2) first and last sixteenth of their boxes.
    """
    faces, place = [], (ends.sum(axis=2) - 15) / 32.0
    sides = size / 16.0 * (1 + ends[..., 1].max(axis=0) - ends[..., 0].min(axis=0))
    for axis in range(3):
        for sign in (1.0, -1.0):
            along = area * np.maximum(sign * normals[:, axis], 0.0)
            front = along * np.exp(FRONT * sign * place[:, axis])
            hidden = np.clip(along.sum() / (sides.prod() / sides[axis]) - 1.0, 0.0, 1.0) ** 2
            mean, first = along @ light / along.sum(), front @ light / front.sum()
            faces.append((mean + hidden * (first - mean), along.sum()))
    found, areas = np.array(faces).T
    return found, areas


def seen_reference(octree: Octree, nodes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Linear colours (N, 3) float64 of nodes (N,) along directions (N, 3)."""
    colors = octree.color_float(nodes).astype(np.float64)
    for i, (node, way) in enumerate(zip(nodes.tolist(), directions.astype(np.float64), strict=True)):
        row = int(np.searchsorted(octree.side_nodes, node))
        if row == len(octree.side_nodes) or octree.side_nodes[row] != node:
            continue
        faces = [2 * axis + int(way[axis] > 0) for axis in range(3)]
        weight = np.abs(way) * octree.side_share[row, faces] / 255.0
        is_back = octree.side_share[row, faces] % 2 == 1
        counts = np.where(is_back & (octree.side_light[row, faces] == 0), weight / 8.0, weight)
        backs = counts[is_back].sum() > counts[~is_back].sum()
        weight[is_back != backs] = 0.0
        light = (octree.side_light[row, faces] / 255.0) ** 2
        shown = np.repeat(light[:, None], 3, axis=1)
        if octree.side_chroma is not None:
            shown = decoded_colors(light, octree.side_chroma[row, faces])
        rest = 1.0 / 255.0 + (np.abs(way).sum() - weight.sum() if octree.child_mask[node] and not backs else 0.0)
        colors[i] = (rest * colors[i] + weight @ shown) / (rest + weight.sum())
    return colors


def luminance_reference(octree: Octree, nodes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Luminance (...,) float32 of nodes (...,) along directions (..., 3)."""
    if octree.side_nodes is None:
        return octree.luminance_float(nodes)
    ways = np.broadcast_to(directions, (*nodes.shape, 3)).reshape(-1, 3)
    colors = seen_reference(octree, nodes.ravel(), ways)
    return np.asarray(colors @ REC709.astype(np.float64), np.float32).reshape(nodes.shape)


def composed_reference(children: list[int], face: int, light, share, cover) -> tuple[float, float, bool]:
    """Luminance and share that a face of a node shows of its eight children, -1 for none, and whether most are backs.

    light: (c, 6) of children, in [0, 1]. share: (c, 6) uint16, odd for backs. cover: (c, 3) in [0, 1].
    """
    axis, seen = face // 2, []
    for octant in range(8):
        if (octant >> axis & 1 == 0) != bool(face & 1):
            continue
        free = 1.0
        for child in (children[octant], children[octant ^ 1 << axis]):
            if child >= 0:
                seen.append((free * share[child, face] / 65535.0, light[child, face], share[child, face] % 2))
                free *= 1.0 - cover[child, axis]
    weight, values, backs = np.array(seen, np.float64).reshape(-1, 3).T
    total = weight.sum()
    return (weight @ values / total if total else 0.0), total / 4.0, bool(2.0 * weight @ backs > total)
