# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY export: voxels as a binary point cloud, which Blender, MeshLab, CloudCompare and Open3D read.

x, y, z          centre in world units
nx, ny, nz       mean normal; shorter than 1 where the surface in the voxel is curved or has two sides
red, green, blue colour for the eye, or luminance where the octree has none: sRGB, 0 to 255
scalar_luminance linear, 0 to 1; CloudCompare uses this prefix for values of points scalar_side side of the voxel in
world units scalar_area surface in the voxel in square world units

A comment says where baked light is fine, and its noise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..image.tone import srgb_encode, to_bytes
from ..octree.octree import Octree
from ..octree.voxel_cloud import VoxelRun, voxel_counts, voxel_runs
from ..runtime.file_kinds import PLY
from ..runtime.progress import Progress, Steps
from ..runtime.replace import replaced_file
from .fine_light import fine_light_text

_FLOATS = ["x", "y", "z", "nx", "ny", "nz"]
_COLOURS = ["red", "green", "blue"]
_SCALARS = ["scalar_luminance", "scalar_side", "scalar_area"]
_ROW = np.dtype([(n, "<f4") for n in _FLOATS] + [(n, "u1") for n in _COLOURS] + [(n, "<f4") for n in _SCALARS])


def write_ply(octree: Octree, level: int, path: Path) -> Steps[int]:
    """Write the voxels of `level` to `path`; returns their number; raises PatchNetError if it cannot be written."""
    total, done = int(voxel_counts(octree)[level]), 0
    with replaced_file(path, PLY) as file:
        file.write(_header(level, total, fine_light_text(octree)))
        for run in voxel_runs(octree, level):
            file.write(_rows(run).tobytes())
            done += len(run)
            yield Progress(done, total, "Writing voxels")
    return total


def _header(level: int, count: int, light: str) -> bytes:
    types = {"<f4": "float", "|u1": "uchar"}
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment PatchNet voxels, level {level}",
        *([f"comment {light}"] if light else []),
        f"element vertex {count}",
        *(f"property {types[_ROW[name].str]} {name}" for name in _ROW.names or ()),
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii")


def _rows(run: VoxelRun) -> np.ndarray:
    """Vertices (n,) of the file."""
    rows = np.empty(len(run), _ROW)
    for axes, values in (("x y z", run.centres_world), ("nx ny nz", run.normal)):
        for axis, name in enumerate(axes.split()):
            rows[name] = values[:, axis]
    for name, values in zip(_COLOURS, to_bytes(srgb_encode(run.color)).T, strict=True):
        rows[name] = values
    rows["scalar_luminance"], rows["scalar_side"], rows["scalar_area"] = run.luminance, run.side_world, run.area_world
    return rows
