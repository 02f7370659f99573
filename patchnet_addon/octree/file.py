# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree files: the node arrays as they are, the cube and the provenance as metadata."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import OctreeFileError, SettingError
from ..files import content_hash, read_arrays, write_arrays
from .grid import Grid
from .octree import POPCOUNT, Octree

KIND = "octree"
_DTYPES = {
    "level_start": np.int64,
    "child_mask": np.uint8,
    "first_child": np.uint32,
    "area_world": np.float32,
    "luminance": np.uint16,
    "normal": np.int8,
}


def octree_arrays(octree: Octree) -> dict[str, np.ndarray]:
    """The arrays that a file holds."""
    return {name: getattr(octree, name) for name in _DTYPES}


def octree_hash(octree: Octree) -> str:
    """Identity of the octree's contents; codes state it, so that they are never used with another octree."""
    return content_hash(octree_arrays(octree))


def save_octree(octree: Octree, path: str | Path) -> None:
    """Write `octree` to `path`, atomically; raises PatchNetError if it cannot be written."""
    grid = octree.grid
    metadata = {
        "origin_world": list(grid.origin_world),
        "side_world": grid.side_world,
        "depth": grid.depth,
        "exposure": octree.exposure,
        "provenance": octree.provenance,
    }
    write_arrays(path, octree_arrays(octree), metadata, KIND)


def load_octree(path: str | Path) -> Octree:
    """Read an octree file, memory-mapped.

    Raises OctreeFileError naming file and cause if it is missing, foreign, damaged or inconsistent.
    """
    arrays, metadata = read_arrays(path, KIND, OctreeFileError)
    for name, dtype in _DTYPES.items():
        if name not in arrays or arrays[name].dtype != dtype:
            raise OctreeFileError(
                f"{path} is damaged: array '{name}' is missing or of a wrong type; create the file anew"
            )
    try:
        x, y, z = (float(value) for value in metadata["origin_world"])
        grid = Grid((x, y, z), float(metadata["side_world"]), int(metadata["depth"]))
        exposure, provenance = float(metadata["exposure"]), dict(metadata["provenance"])
    except (KeyError, TypeError, ValueError, SettingError) as cause:
        raise OctreeFileError(
            f"{path} is damaged: its metadata are incomplete ({cause}); create the file anew"
        ) from cause
    problem = _inconsistency(arrays, grid.depth)
    if problem:
        raise OctreeFileError(f"{path} is inconsistent: {problem}; create the file anew")
    columns = {name: arrays[name] for name in _DTYPES}
    return Octree(grid=grid, exposure=exposure, provenance=provenance, **columns)  # type: ignore[arg-type]


def _inconsistency(arrays: dict[str, Any], depth: int) -> str:
    """What contradicts the structure of an octree, or an empty text.

    Children must stand behind their parents, in order and without gaps, so that no walk can leave the arrays or turn
    in a circle.
    """
    start, mask, first = arrays["level_start"], arrays["child_mask"], arrays["first_child"]
    count = len(mask)
    if any(len(arrays[name]) != count for name in ("first_child", "area_world", "luminance", "normal")):
        return "its arrays differ in length"
    if arrays["normal"].shape != (count, 3) or mask.ndim != 1:
        return "its arrays have wrong shapes"
    if len(start) != depth + 2 or start[0] != 0 or start[1] != 1 or start[-1] != count or (np.diff(start) < 0).any():
        return "its levels do not add up to its nodes"
    counts = POPCOUNT[mask].astype(np.int64)
    if 1 + int(counts.sum()) != count or counts[start[depth] :].any():
        return "its children do not add up to its nodes"
    expected = 1 + np.cumsum(counts) - counts
    if not np.array_equal(expected[mask != 0], first[mask != 0].astype(np.int64)):
        return "a child index is out of order"
    for level in range(depth):
        if counts[start[level] : start[level + 1]].sum() != start[level + 2] - start[level + 1]:
            return f"level {level + 1} does not hold the children of level {level}"
    if not np.isfinite(arrays["area_world"]).all() or (arrays["area_world"] < 0).any():
        return "an area is not a positive number"
    return ""
