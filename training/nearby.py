# SPDX-License-Identifier: GPL-3.0-or-later
"""Luminances near training voxels, which a luminance mixture mixes, after each voxel's augmentation (methods 11.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ..patchnet_addon.codes.axis_luminance import AXES, axis_coverage_table, write_axis_luminance
from ..patchnet_addon.codes.brick import child_at, covering_node
from ..patchnet_addon.codes.corner_luminance import luminance_around
from ..patchnet_addon.network.kinds import CHILDREN, CORNERS
from ..patchnet_addon.octree.octree import LUMINANCE_SCALE
from ..patchnet_addon.runtime.kernels import kernel
from .forest import Forest
from .symmetry import cube_symmetries

_OCTANTS = 1  # look-ahead whose blocks are the eight octants


@dataclass(frozen=True, eq=False)
class Nearby:
    """Luminances near V voxels, float32.

    covered, shown: (V, 8, 6) coverage and luminance of each child along the axes (`codes/axis_luminance.py`). own:
    (V,) of the voxel. around: (V, 8) around its corners.
    """

    covered: np.ndarray
    shown: np.ndarray
    own: np.ndarray
    around: np.ndarray


def gather_nearby(
    forest: Forest, tree: np.ndarray, voxel: np.ndarray, symmetry: np.ndarray, linear: np.ndarray
) -> Nearby:
    """Luminances near voxels (V, 4) of octrees `tree` (V,), turned by `symmetry` (V,).

    linear: (V, 2) gain and offset of luminance.
    """
    count = len(tree)
    covered, shown = np.zeros((count, CHILDREN, AXES), np.float32), np.zeros((count, CHILDREN, AXES), np.float32)
    own, around = np.empty(count, np.float32), np.empty((count, CORNERS), np.float32)
    table = axis_coverage_table()
    where = forest.root[tree], voxel.astype(np.int64)
    _gather(forest.nodes, forest.luminance, *where, table, covered, shown, own, around)
    gain, offset = linear[:, 0] / np.float32(LUMINANCE_SCALE), linear[:, 1]
    octant, side = (table[symmetry] for table in _sources())  # (V, 8), (V, 6)
    rows = np.arange(count)[:, None]
    turned = rows[..., None], octant[:, :, None], side[:, None, :]
    return Nearby(
        covered[turned],
        gain[:, None, None] * shown[turned] + offset[:, None, None],
        gain * own + offset,
        gain[:, None] * around[rows, octant] + offset[:, None],
    )


@cache
def _sources() -> tuple[np.ndarray, np.ndarray]:
    """Octant (48, 8) and direction along an axis (48, 6) that come to each place by the symmetries of the cube."""
    symmetries = cube_symmetries(_OCTANTS)
    down = np.arange(2)  # 0: travels up the axis
    turned = np.where(symmetries.sign[..., None] > 0, down, 1 - down)  # (48, 3, 2)
    return np.argsort(symmetries.cell, axis=1), (2 * symmetries.axis[..., None] + turned).reshape(-1, AXES)


@kernel
def _gather(nodes, luminance, root, voxel, table, covered, shown, own, around):
    six = np.empty(AXES, np.uint16)
    for v in range(len(root)):
        level, x, y, z = voxel[v, 0], voxel[v, 1], voxel[v, 2], voxel[v, 3]
        node = covering_node(nodes, root[v], level, x, y, z)
        own[v] = luminance[node]
        for octant in range(CHILDREN):
            column, line, plane = octant & 1, (octant >> 1) & 1, octant >> 2
            around[v, octant] = luminance_around(nodes, luminance, root[v], level, x + column, y + line, z + plane)
            child = child_at(nodes, node, octant)
            if child >= 0:
                write_axis_luminance(nodes, luminance, child, six)
                for side in range(AXES):
                    covered[v, octant, side] = table[nodes.child_mask[child], side]
                    shown[v, octant, side] = six[side]
