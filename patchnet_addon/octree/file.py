# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree files: the node arrays as they are, the cube and the provenance as metadata."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..cells.morton import POPCOUNT
from ..runtime.bounds import UINT32_COUNT
from ..runtime.errors import OctreeFileError, SettingError
from ..runtime.files import content_hash, read_arrays, write_arrays
from ..surface.sides import FACES
from .grid import Grid
from .octree import Octree
from .pieces import PIECES_VERSION, are_consistent, piece_arrays, pieces_of

KIND = "octree"
_DTYPES = {
    "level_start": np.int64,
    "child_mask": np.uint8,
    "first_child": np.uint32,
    "area_world": np.float32,
    "luminance": np.uint16,
    "normal": np.int8,
}
# Files without colour, light above white, boxes or sides lack these arrays, those of boxes also `piece_arrays`; older
# readers ignore them.
_OPTIONAL_DTYPES = {
    "chroma": np.uint8,
    "bright_nodes": np.uint32,
    "bright_colors": np.float32,
    "leaf_box": np.uint8,
    "side_nodes": np.uint32,
    "side_light": np.uint8,
    "side_share": np.uint8,
    "side_chroma": np.uint8,
}
# Arrays of which a file has all or none.
_GROUPS = ({"bright_nodes", "bright_colors"}, {"side_nodes", "side_light", "side_share"})


def octree_arrays(octree: Octree) -> dict[str, np.ndarray]:
    """Arrays of a file."""
    arrays = {name: getattr(octree, name) for name in (*_DTYPES, *_OPTIONAL_DTYPES)}
    pieces = {} if octree.pieces is None else piece_arrays(octree.pieces)
    return {name: array for name, array in arrays.items() if array is not None} | pieces


def octree_hash(octree: Octree) -> str:
    """Hash of the octree's contents; codes store it, so that they are never used with another octree."""
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
    if octree.pieces is not None:
        metadata["pieces"] = PIECES_VERSION
    write_arrays(path, octree_arrays(octree), metadata, KIND)


def load_octree(path: str | Path) -> Octree:
    """Read an octree file, memory-mapped.

    Raises OctreeFileError naming file and cause if it is missing, foreign, damaged or inconsistent.
    """
    every, metadata = read_arrays(path, KIND, OctreeFileError)
    arrays = {name: array for name, array in every.items() if name in _DTYPES or name in _OPTIONAL_DTYPES}
    for name, dtype in (_DTYPES | {name: kind for name, kind in _OPTIONAL_DTYPES.items() if name in arrays}).items():
        if name not in arrays or arrays[name].dtype != dtype:
            raise OctreeFileError(
                f"{path} is damaged: array '{name}' is missing or of a wrong type; create the file anew"
            )
    try:
        x, y, z = (float(value) for value in metadata["origin_world"])
        grid = Grid((x, y, z), float(metadata["side_world"]), int(metadata["depth"]))
        exposure, provenance = float(metadata["exposure"]), dict(metadata["provenance"])
        if not all(math.isfinite(value) for value in (x, y, z, exposure)):
            raise ValueError("a number is not finite")
    except (KeyError, TypeError, ValueError, OverflowError, SettingError) as cause:
        raise OctreeFileError(
            f"{path} is damaged: its metadata are incomplete ({cause}); create the file anew"
        ) from cause
    problem = _inconsistency(arrays, grid.depth)
    if problem:
        raise OctreeFileError(f"{path} is inconsistent: {problem}; create the file anew")
    pieces = None
    if metadata.get("pieces") == PIECES_VERSION:  # of another version, the file opens as boxes
        pieces = pieces_of(every)
        if pieces is None or not are_consistent(pieces, arrays["first_child"][arrays["child_mask"] == 0]):
            raise OctreeFileError(f"{path} is inconsistent: its pieces do not fit its leaves; create the file anew")
    return Octree(grid=grid, exposure=exposure, provenance=provenance, pieces=pieces, **arrays)


def _inconsistency(arrays: dict[str, Any], depth: int) -> str:
    """Return the first inconsistency in the structure of an octree, or an empty text; values have checksums.

    Children must follow their parents, in order and without gaps, so that no walk can leave the arrays or loop.
    """
    start, mask = arrays["level_start"], arrays["child_mask"]
    count = mask.size
    if start.shape != (depth + 2,) or (start[0], start[1], start[-1]) != (0, 1, count) or (np.diff(start) < 0).any():
        return "its levels do not add up to its nodes"
    if count > UINT32_COUNT:
        return f"it has {count:,} nodes, which exceed 32-bit indices"
    if any(0 < len(group & arrays.keys()) < len(group) for group in _GROUPS):
        return "its sides or its light above white are incomplete"
    if ("side_chroma" in arrays) != ("side_nodes" in arrays and "chroma" in arrays):
        return "the colours of its sides are not as many as its sides"
    bright, sides = (arrays.get(name, np.empty(0, np.uint32)) for name in ("bright_nodes", "side_nodes"))
    shapes = dict.fromkeys(("child_mask", "first_child", "area_world", "luminance"), (count,)) | {
        "normal": (count, 3),
        "chroma": (count, 2),
        "leaf_box": (int(start[-1] - start[-2]), 3),
        "bright_nodes": (bright.size,),
        "bright_colors": (bright.size, 3),
        "side_nodes": (sides.size,),
        "side_light": (sides.size, FACES),
        "side_share": (sides.size, FACES),
        "side_chroma": (sides.size, FACES, 2),
    }
    if any(arrays[name].shape != shape for name, shape in shapes.items() if name in arrays):
        return "its arrays differ in length"
    if any((nodes[1:] <= nodes[:-1]).any() or (nodes[-1:] >= count).any() for nodes in (bright, sides)):
        return "a node with sides or with light above white is out of order"
    children = POPCOUNT[mask]
    if int(children.sum(dtype=np.int64)) != count - 1:
        return "its children do not add up to its nodes"
    first = np.cumsum(children, dtype=np.uint32) - children + np.uint32(1)
    if ((first != arrays["first_child"]) & (children > 0)).any():
        return "a child index is out of order"
    if (np.append(first, np.uint32(count))[start[:-1]] != start[1:]).any():
        return "the children of a level do not add up to the next one"
    return ""
