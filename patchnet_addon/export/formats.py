# SPDX-License-Identifier: GPL-3.0-or-later
"""Export formats of voxels, by file extension."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..octree.octree import Octree
from ..octree.voxel_cloud import check_level
from ..runtime.errors import SettingError
from ..runtime.file_kinds import NPZ, OCTREE, PLY, VDB, FileKind
from ..runtime.progress import Steps
from .npz import write_npz
from .octree_file import write_octree
from .ply import write_ply
from .vdb import write_vdb


@dataclass(frozen=True)
class Format:
    """Format: the kind of its files, and the function that writes a level's voxels and returns their number."""

    kind: FileKind
    write: Callable[[Octree, int, Path], Steps[int]]


FORMATS: dict[str, Format] = {
    ".ply": Format(PLY, write_ply),
    ".vdb": Format(VDB, write_vdb),
    ".npz": Format(NPZ, write_npz),
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
