# SPDX-License-Identifier: GPL-3.0-or-later
"""Luminance and coverage of voxels along the axes: what a voxel's children show to rays along +x, -x, +y, -y, +z, -z.

A child is seen where no other stands before it. Between the axes both are means of three, weighed by the squares of a
direction's components (ambient cubes), so that a voxel with a bright front and a dark back shows either (methods 11.1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts

AXES = 6  # 2 a: rays that travel up axis a, 2 a + 1: down
_COLUMNS = 4  # of two children each, along an axis


def axis_coverage_table() -> np.ndarray:
    """Coverage (256, 6) float32 in [0, 1] of a voxel by its child mask: columns along each axis that have a child.

    A mask of 0 is that of a leaf, which is all of its cell.
    """
    masks, octants = np.arange(256)[:, None], np.arange(8)
    table = np.ones((256, AXES), np.float32)
    for axis in range(3):
        near = octants[octants >> axis & 1 == 0]
        filled = (masks >> near | masks >> (near | 1 << axis)) & 1
        table[1:, 2 * axis : 2 * axis + 2] = filled[1:].sum(axis=1, keepdims=True) / _COLUMNS
    return table


def axis_luminance(octree: Octree) -> np.ndarray:
    """Luminance (I, 6) uint16 that the first I nodes show along the axes, in units of the octree's luminance.

    I: nodes of all levels but the deepest, which are the first ones. 12 bytes a node, of a quarter of all nodes.
    """
    end = int(octree.level_start[octree.depth])
    result = np.empty((end, AXES), np.uint16)
    run_parts(_write_all, end, octree.nodes, octree.luminance, result)
    return result


def axis_luminance_reference(octree: Octree) -> np.ndarray:
    """Reference of `axis_luminance` in NumPy, float64 (I, 6) and not rounded."""
    end = int(octree.level_start[octree.depth])
    mask = octree.child_mask[:end].astype(np.int64)
    octants = np.arange(8)
    there = mask[:, None] >> octants & 1 == 1
    place = np.cumsum(there, axis=1) - 1
    child = np.where(there, octree.first_child[:end].astype(np.int64)[:, None] + place, 0)
    luminance = octree.luminance[child].astype(np.float64)
    result = np.empty((end, AXES))
    for axis in range(3):
        low = octants[octants >> axis & 1 == 0]
        for down, (near, far) in enumerate(((low, low | 1 << axis), (low | 1 << axis, low))):
            filled = there[:, near] | there[:, far]
            shown = np.where(there[:, near], luminance[:, near], luminance[:, far])
            result[:, 2 * axis + down] = (shown * filled).sum(axis=1) / np.maximum(filled.sum(axis=1), 1)
    result[mask == 0] = octree.luminance[:end][mask == 0, None]
    return result


@kernel
def _write_all(first, last, nodes, luminance, result):  # type: ignore[no-untyped-def]
    for node in range(first, last):
        write_axis_luminance(nodes, luminance, node, result[node])


@device
def write_axis_luminance(nodes, luminance, node, result):  # type: ignore[no-untyped-def]
    """Write the six luminances of a node into `result` (6,), rounded to whole units."""
    mask = np.int64(nodes.child_mask[node])
    if mask == 0:
        result[:] = luminance[node]
        return
    eight = np.empty(8, np.int64)
    child = np.int64(nodes.first_child[node])
    for octant in range(8):
        eight[octant] = -1
        if (mask >> octant) & 1:
            eight[octant] = luminance[child]
            child += 1
    for axis in range(3):
        step = 1 << axis
        up, down, count = np.int64(0), np.int64(0), np.int64(0)
        for octant in range(8):
            if octant & step:
                continue
            low, high = eight[octant], eight[octant | step]
            if low >= 0 or high >= 0:
                count += 1
                up += low if low >= 0 else high
                down += high if high >= 0 else low
        result[2 * axis] = (up + count // 2) // count
        result[2 * axis + 1] = (down + count // 2) // count


class AxisLuminance(NamedTuple):
    """Tables of an octree: `axis_luminance`, and `axis_coverage_table`."""

    luminance: np.ndarray
    coverage: np.ndarray

    @classmethod
    def of(cls, octree: Octree) -> AxisLuminance:
        """Tables of an octree."""
        return cls(axis_luminance(octree), axis_coverage_table())


@device
def child_along(nodes, luminance, axis, child, direction):  # type: ignore[no-untyped-def]
    """Coverage, and luminance in [0, 1], of a node seen along a direction of three numbers.

    luminance: of the octree. axis: `AxisLuminance`, whose nodes of the deepest level are all of their cells.
    """
    scale = np.float32(1.0 / LUMINANCE_SCALE)
    if child >= len(axis.luminance):
        return np.float32(1), np.float32(luminance[child]) * scale
    mask = nodes.child_mask[child]
    covered, light = np.float32(0), np.float32(0)
    for k in range(3):
        along = direction[k]
        side = 2 * k + (1 if along < 0 else 0)
        share = along * along * axis.coverage[mask, side]
        covered += share
        light += share * np.float32(axis.luminance[child, side])
    return covered, light / max(covered, np.float32(1e-12)) * scale


def seen_along(coverage: np.ndarray, luminance: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reference of `child_along`: (N, 8) float32 each for voxels' children, along (N, 3), from (N, 8, 6) each.

    Children that do not exist have coverage 0. Luminance is that of what is covered, in the units given.
    """
    along = direction.astype(np.float32)
    squares = np.stack([np.maximum(along, 0) ** 2, np.minimum(along, 0) ** 2], axis=-1).reshape(-1, 1, AXES)
    shares = squares * coverage
    total = shares.sum(axis=-1)
    light = (shares * luminance).sum(axis=-1)
    return total, np.divide(light, total, out=np.zeros_like(light), where=total > 0)
