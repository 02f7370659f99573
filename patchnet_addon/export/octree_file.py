# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree export down to one level, as an octree file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..octree.file import save_octree
from ..octree.octree import Octree
from ..octree.voxel_cloud import voxel_counts
from ..runtime.errors import SettingError
from ..runtime.progress import Progress, Steps


def truncated(octree: Octree, level: int) -> Octree:
    """Octree without what lies below `level`, whose nodes become leaves; values of nodes stay as they are.

    Raises SettingError for level 0: a single node is no octree.
    """
    if level == octree.depth:
        return octree
    if level < 1:
        raise SettingError("An octree file needs at least level 1: choose a level from 1")
    count = int(octree.level_start[level + 1])
    child_mask = octree.child_mask[:count].copy()
    child_mask[octree.level(level)] = 0
    bright = 0 if octree.bright_nodes is None else int(np.searchsorted(octree.bright_nodes, count))
    sides = 0 if octree.side_nodes is None else int(np.searchsorted(octree.side_nodes, count))
    return replace(
        octree,
        grid=replace(octree.grid, depth=level),
        level_start=octree.level_start[: level + 2],
        child_mask=child_mask,
        first_child=octree.first_child[:count],
        area_world=octree.area_world[:count],
        luminance=octree.luminance[:count],
        normal=octree.normal[:count],
        chroma=None if octree.chroma is None else octree.chroma[:count],
        bright_nodes=None if octree.bright_nodes is None else octree.bright_nodes[:bright],
        bright_colors=None if octree.bright_colors is None else octree.bright_colors[:bright],
        leaf_box=None,
        side_nodes=None if octree.side_nodes is None else octree.side_nodes[:sides],
        side_light=None if octree.side_light is None else octree.side_light[:sides],
        side_share=None if octree.side_share is None else octree.side_share[:sides],
        side_chroma=None if octree.side_chroma is None else octree.side_chroma[:sides],
        _keys={},
    )


def write_octree(octree: Octree, level: int, path: Path) -> Steps[int]:
    """Write the octree down to `level`; returns the voxels of that level; raises PatchNetError."""
    coarse = truncated(octree, level)
    yield Progress(0, 1, "Writing the octree")
    save_octree(coarse, path)
    return int(voxel_counts(octree)[level])
