# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenVDB export: voxels as grids, through the `openvdb` module of Blender's Python.

luminance  linear, 0 to 1
density    surface / (2 * volume) of the voxel, in 1 / world unit: the extinction of a medium that hides, averaged over
           directions, as much as the surface in the voxel would (half of a surface's area is its mean projection).
           It does not depend on the level, and is what a Principled Volume reads by default.
color      vectors, linear Rec. 709 of that luminance; only where the octree has colour

OpenVDB's cell (i, j, k) has its centre at index (i, j, k), so index 0 lies half a voxel inside the octree's cube.
Blender follows this from 5.0 on; older ones show every OpenVDB file half a voxel too far along each axis.
Coarser leaves fill all the cells that they cover, as tiles where OpenVDB has tiles of that size. The file's metadata
name the level, and as "light" where baked light is fine, and its noise.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from ..octree.octree import Octree
from ..octree.voxel_cloud import VoxelRun, voxel_counts, voxel_runs
from ..runtime.errors import PatchNetError, SettingError
from ..runtime.file_kinds import VDB
from ..runtime.progress import Progress, Steps
from ..runtime.replace import replaced_path
from .fine_light import fine_light_text

_MODULES = ("openvdb", "pyopenvdb")  # the name since OpenVDB 12, and the older one
NO_VDB = "This Python has no openvdb module, which .vdb needs: use Blender as blender.org ships it, or choose .ply"
_BLOCK_LEVELS = 5  # cells are handed over in dense blocks of 2^5 along an axis
_CHANNELS = {"luminance": 1, "density": 1, "color": 3}  # of each grid
# OpenVDB drops cells with exactly the background's value; black surfaces must stay.
_BLACK = np.float32(np.finfo(np.float32).tiny)


@functools.cache
def vdb_module_name() -> str:
    """Name of the module that writes .vdb files, "" if missing; searched once, without importing it."""
    return next((name for name in _MODULES if importlib.util.find_spec(name)), "")


def write_vdb(octree: Octree, level: int, path: Path) -> Steps[int]:
    """Write the voxels of `level` to `path`; returns their number.

    OpenVDB holds the grids in memory until they are written: 2 KiB for each block of 8^3 cells that has voxels, and
    6 KiB more with colour.
    Raises SettingError without the module, PatchNetError if the file cannot be written.
    """
    if not vdb_module_name():
        raise SettingError(NO_VDB)
    vdb: Any = importlib.import_module(vdb_module_name())
    names = [name for name in _CHANNELS if name != "color" or octree.chroma is not None]
    grids = {name: _empty_grid(vdb, octree, level, name) for name in names}
    total, done, top = int(voxel_counts(octree)[level]), 0, max(level - _BLOCK_LEVELS, 0)
    for run in voxel_runs(octree, top):
        for index in range(len(run)):
            node = run.only(slice(index, index + 1))
            done += _fill(grids, node, level) if run.level < top else _copy_block(grids, node, level)
            yield Progress(done, total, "Filling the grids")
    yield Progress(0, 1, "Writing the grids")
    light = fine_light_text(octree)
    metadata = {"creator": "PatchNet", "level": level} | ({"light": light} if light else {})
    with replaced_path(path, VDB) as temporary:
        try:
            vdb.write(str(temporary), grids=list(grids.values()), metadata=metadata)
        except RuntimeError as cause:
            raise PatchNetError(f"{path} cannot be written: {cause}; choose another folder or make room") from cause
    return total


def _empty_grid(vdb: Any, octree: Octree, level: int, name: str) -> Any:
    side = octree.grid.side_world / (1 << level)
    transform = vdb.createLinearTransform(voxelSize=side)
    x, y, z = (axis + side / 2 for axis in octree.grid.origin_world)
    transform.translate((x, y, z))
    grid = vdb.FloatGrid() if _CHANNELS[name] == 1 else vdb.Vec3SGrid()  # background 0
    grid.name, grid.transform, grid.gridClass = name, transform, vdb.GridClass.FOG_VOLUME
    return grid


def _values(run: VoxelRun, name: str) -> np.ndarray:
    """Values (n,) float32 of a grid, (n, 3) of one of vectors."""
    if name == "color":
        values = run.color
    else:
        values = run.luminance if name == "luminance" else run.area_world / (2.0 * run.side_world**3)
    return np.maximum(values.astype(np.float32), _BLACK)


def _fill(grids: dict[str, Any], leaf: VoxelRun, level: int) -> int:
    """Fill a coarse leaf as tiles; returns 1, the number of voxels."""
    width = 1 << (level - leaf.level)
    low = leaf.cells[0] * width
    corners = tuple(low.tolist()), tuple((low + width - 1).tolist())
    for name, grid in grids.items():
        value = _values(leaf, name)[0].tolist()
        grid.fill(*corners, tuple(value) if _CHANNELS[name] == 3 else value, True)
    return 1


def _copy_block(grids: dict[str, Any], node: VoxelRun, level: int) -> int:
    """Copy all voxels below one node, through dense arrays; returns their number."""
    side, count = 1 << (level - node.level), 0
    low = node.cells[0] * side
    dense = {name: np.zeros((side, side, side, _CHANNELS[name]), np.float32) for name in grids}
    for run in voxel_runs(node.octree, level, node):
        width = 1 << (level - run.level)
        parts = side // width
        x, y, z = (run.cells - low // width).T
        for name, values in dense.items():
            tiled = values.reshape(parts, width, parts, width, parts, width, -1)
            tiled[x, :, y, :, z] = _values(run, name).reshape(len(run), 1, 1, 1, -1)  # (n, width, width, width, C)
        count += len(run)
    for name, grid in grids.items():
        cells = dense[name] if _CHANNELS[name] == 3 else dense[name][..., 0]
        grid.copyFromArray(cells, ijk=tuple(low.tolist()))
    return count
