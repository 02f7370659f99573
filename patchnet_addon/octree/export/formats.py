# SPDX-License-Identifier: GPL-3.0-or-later
"""The formats that voxels are exported to, by the ending of the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...errors import SettingError
from ...progress import Steps
from ..octree import Octree
from ..voxel_cloud import check_level
from .npz import write_npz
from .octree_file import write_octree
from .ply import write_ply
from .vdb import write_vdb

# Each writes the voxels of a level and returns how many they are.
FORMATS: dict[str, Callable[[Octree, int, Path], Steps[int]]] = {
    ".ply": write_ply,
    ".vdb": write_vdb,
    ".npz": write_npz,
    ".safetensors": write_octree,
}


def export_octree(octree: Octree, path: str | Path, level: int | None = None) -> Steps[int]:
    """Write the voxels of `level` (None: the finest) in the format that the ending of `path` names; their number.

    The file appears complete or not at all. Raises SettingError for an unknown ending or level, before any work, and
    PatchNetError if the file cannot be written.
    """
    path = Path(path)
    write = FORMATS.get(path.suffix.lower())
    if write is None:
        raise SettingError(f"{path} has no ending that names a format: choose one of {', '.join(FORMATS)}")
    return write(octree, octree.depth if level is None else check_level(octree, level), path)
