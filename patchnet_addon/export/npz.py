# SPDX-License-Identifier: GPL-3.0-or-later
"""NumPy export: voxels as arrays, for which `numpy.load(path)` needs no pickle.

cells         (n, 3) int32    integer cell of each voxel at its own level
level         (n,) uint8      its level; lower than the exported one for leaves that are coarser
centres_world (n, 3) float32  centre in world units
side_world    (n,) float32    side in world units
luminance     (n,) float32    linear, 0 to 1, times the exposure below
color         (n, 3) float32  linear Rec. 709 of that luminance; only where the octree has colour
normal        (n, 3) float32  mean normal, length at most 1
area_world    (n,) float32    surface in the voxel, weighed by opacity

and of the whole: grid_origin_world (3,) and grid_side_world () float64, the cube; grid_depth () and export_level ()
int64; exposure () float64; light () text, where light is fine and its noise, only of baked light; provenance () text,
JSON. A voxel of level l has its low corner at
grid_origin_world + cells * grid_side_world / 2**l.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..octree.octree import Octree
from ..octree.voxel_cloud import VoxelRun, voxel_counts, voxel_runs
from ..runtime.file_kinds import NPZ
from ..runtime.progress import Progress, Steps
from ..runtime.replace import replaced_file
from .fine_light import fine_light_text

# Type and width of each column, and its function of a run of voxels. A width of 0 makes a flat array.
_COLUMNS: dict[str, tuple[str, int, Callable[[VoxelRun], np.ndarray]]] = {
    "cells": ("<i4", 3, lambda run: run.cells),
    "level": ("|u1", 0, lambda run: np.full(len(run), run.level)),
    "centres_world": ("<f4", 3, lambda run: run.centres_world),
    "side_world": ("<f4", 0, lambda run: np.full(len(run), run.side_world)),
    "luminance": ("<f4", 0, lambda run: run.luminance),
    "normal": ("<f4", 3, lambda run: run.normal),
    "area_world": ("<f4", 0, lambda run: run.area_world),
    "color": ("<f4", 3, lambda run: run.color),
}


def write_npz(octree: Octree, level: int, path: Path) -> Steps[int]:
    """Write the voxels of `level` to `path`; returns their number; raises PatchNetError if it cannot be written.

    The file stores column after column, so the octree is walked once for each of them.
    """
    count = int(voxel_counts(octree)[level])
    columns = {name: column for name, column in _COLUMNS.items() if name != "color" or octree.chroma is not None}
    done = 0
    with replaced_file(path, NPZ) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, (dtype, width, column) in columns.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                shape = (count, width) if width else (count,)
                header = {"descr": dtype, "fortran_order": False, "shape": shape}
                np.lib.format.write_array_header_1_0(entry, header)  # type: ignore[arg-type]
                for run in voxel_runs(octree, level):
                    entry.write(np.ascontiguousarray(column(run), np.dtype(dtype)).tobytes())
                    done += len(run)
                    yield Progress(done, count * len(columns), "Writing voxels")
        for name, value in _whole(octree, level).items():
            with archive.open(f"{name}.npy", "w") as entry:
                np.lib.format.write_array(entry, value, allow_pickle=False)  # type: ignore[arg-type]
    return count


def _whole(octree: Octree, level: int) -> dict[str, np.ndarray]:
    """Arrays of the whole octree, written once."""
    light = fine_light_text(octree)
    return {
        "grid_origin_world": np.array(octree.grid.origin_world, "<f8"),
        "grid_side_world": np.array(octree.grid.side_world, "<f8"),
        "grid_depth": np.array(octree.depth, "<i8"),
        "export_level": np.array(level, "<i8"),
        "exposure": np.array(octree.exposure, "<f8"),
        "provenance": np.array(json.dumps(octree.provenance)),
    } | ({"light": np.array(light)} if light else {})
