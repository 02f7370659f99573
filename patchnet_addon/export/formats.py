# SPDX-License-Identifier: GPL-3.0-or-later
"""Export formats of voxels, by file extension."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..octree.file import save_octree
from ..octree.octree import Octree
from ..octree.voxel_cloud import check_level, voxel_counts
from ..runtime.errors import SettingError
from ..runtime.file_kinds import OCTREE, PLY, VDB, FileKind
from ..runtime.progress import Progress, Steps
from .ply import write_ply
from .vdb import write_vdb


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
    ends = dict.fromkeys(("first_child", "area_world", "luminance", "normal", "chroma"), count)
    if octree.bright_nodes is not None:
        ends |= dict.fromkeys(("bright_nodes", "bright_colors"), int(np.searchsorted(octree.bright_nodes, count)))
    if octree.side_nodes is not None:
        sides = int(np.searchsorted(octree.side_nodes, count))
        ends |= dict.fromkeys(("side_nodes", "side_light", "side_share", "side_chroma"), sides)
    kept = {name: getattr(octree, name)[:end] for name, end in ends.items() if getattr(octree, name) is not None}
    grid, starts = replace(octree.grid, depth=level), octree.level_start[: level + 2]
    return replace(octree, grid=grid, level_start=starts, child_mask=child_mask, leaf_box=None, pieces=None, **kept)


def write_octree(octree: Octree, level: int, path: Path) -> Steps[int]:
    """Write the octree down to `level`; returns the voxels of that level; raises PatchNetError."""
    coarse = truncated(octree, level)
    yield Progress(0, 1, "Writing the octree")
    save_octree(coarse, path)
    return int(voxel_counts(octree)[level])


@dataclass(frozen=True)
class Format:
    """Format: the kind of its files, and the function that writes a level's voxels and returns their number."""

    kind: FileKind
    write: Callable[[Octree, int, Path], Steps[int]]


FORMATS: dict[str, Format] = {
    ".ply": Format(PLY, write_ply),
    ".vdb": Format(VDB, write_vdb),
    ".safetensors": Format(OCTREE, write_octree),
}


def format_of(path: Path) -> Format:
    """Format by the ending of `path`; raises SettingError for an unknown one."""
    found = FORMATS.get(path.suffix.lower())
    if found is None:
        raise SettingError(f"{path} has no ending that names a format: choose one of {', '.join(FORMATS)}")
    return found


def export_octree(octree: Octree, path: str | Path, level: int | None = None) -> Steps[int]:
    """Write the voxels of `level` (None: the finest) in the format of the ending of `path`; returns their number.

    The file is replaced atomically. Raises SettingError for an unknown ending or level, before any work, and
    OutputError if the file cannot be written.
    """
    path = Path(path)
    chosen = format_of(path)
    return chosen.write(octree, octree.depth if level is None else check_level(octree, level), path)
