# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree files: the node arrays as they are, the cube and the provenance as metadata."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..runtime.bounds import UINT32_COUNT
from ..runtime.errors import OctreeFileError, SettingError
from ..runtime.files import content_hash, read_arrays, write_arrays
from .grid import Grid
from .octree import POPCOUNT, Octree
from .sides import FACES

KIND = "octree"
_INFINITY_BITS = 0x7F800000
_PIECE = 1 << 16
_DTYPES = {
    "level_start": np.int64,
    "child_mask": np.uint8,
    "first_child": np.uint32,
    "area_world": np.float32,
    "luminance": np.uint16,
    "normal": np.int8,
}
# Files without colour, light above white, boxes or sides lack these arrays; older readers ignore them.
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


def octree_arrays(octree: Octree) -> dict[str, np.ndarray]:
    """Arrays of a file."""
    arrays = {name: getattr(octree, name) for name in (*_DTYPES, *_OPTIONAL_DTYPES)}
    return {name: array for name, array in arrays.items() if array is not None}


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
    write_arrays(path, octree_arrays(octree), metadata, KIND)


def load_octree(path: str | Path) -> Octree:
    """Read an octree file, memory-mapped.

    Raises OctreeFileError naming file and cause if it is missing, foreign, damaged or inconsistent.
    """
    arrays, metadata = read_arrays(path, KIND, OctreeFileError)
    arrays = {name: array for name, array in arrays.items() if name in _DTYPES or name in _OPTIONAL_DTYPES}
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
    return Octree(grid=grid, exposure=exposure, provenance=provenance, **arrays)  # type: ignore[arg-type]


def _inconsistency(arrays: dict[str, Any], depth: int) -> str:
    """Return the first inconsistency in the structure of an octree, or an empty text.

    Children must follow their parents, in order and without gaps, so that no walk can leave the arrays or loop.
    """
    count = arrays["child_mask"].size
    shapes = dict.fromkeys(("child_mask", "first_child", "area_world", "luminance"), (count,)) | {
        "level_start": (depth + 2,), "normal": (count, 3)
    } | ({"chroma": (count, 2)} if "chroma" in arrays else {})  # fmt: skip
    if arrays["level_start"].shape != shapes["level_start"]:
        return "its levels do not add up to its nodes"
    if any(arrays[name].shape != shape for name, shape in shapes.items()):
        return "its arrays differ in length"
    if count > UINT32_COUNT:
        return f"it has {count:,} nodes, which exceed 32-bit indices"
    start = arrays["level_start"]
    if start[0] != 0 or start[1] != 1 or start[-1] != count or (start[1:] < start[:-1]).any():
        return "its levels do not add up to its nodes"
    # Positive numbers sort like their bits; infinity, NaN and negative numbers follow.
    if arrays["area_world"].view(np.uint32).max() >= _INFINITY_BITS:
        return "an area is not a positive number"
    if problem := _bright_problem(arrays, count) or _box_problem(arrays) or _side_problem(arrays, count):
        return problem
    return _children_problem(start.tolist(), arrays["child_mask"], arrays["first_child"])


def _bright_problem(arrays: dict[str, Any], count: int) -> str:
    """Return an inconsistency of light above white, or an empty text: nodes must be distinct and in order."""
    nodes, colors = arrays.get("bright_nodes"), arrays.get("bright_colors")
    if nodes is None and colors is None:
        return ""
    if nodes is None or colors is None or nodes.ndim != 1 or colors.shape != (len(nodes), 3):
        return "its light above white is incomplete"
    if (nodes[1:] <= nodes[:-1]).any() or (len(nodes) and nodes[-1] >= count):
        return "a node with light above white is out of order"
    return "" if np.isfinite(colors).all() and (colors >= 0.0).all() else "light above white is not a positive number"


def _side_problem(arrays: dict[str, Any], count: int) -> str:
    """Return an inconsistency of sides, or an empty text: nodes must be distinct and in order."""
    nodes, light, share = (arrays.get(name) for name in ("side_nodes", "side_light", "side_share"))
    if nodes is None or light is None or share is None:
        return "" if nodes is light is share is arrays.get("side_chroma") is None else "its sides are incomplete"
    rows, chroma = nodes.shape[0], arrays.get("side_chroma")
    if nodes.ndim != 1 or light.shape != (rows, FACES) or share.shape != (rows, FACES):
        return "its sides are incomplete"
    if (chroma is None) != ("chroma" not in arrays) or (chroma is not None and chroma.shape != (rows, FACES, 2)):
        return "the colours of its sides are not as many as its sides"
    if (nodes[1:] <= nodes[:-1]).any() or (rows and nodes[-1] >= count):
        return "a node with sides is out of order"
    return ""


def _box_problem(arrays: dict[str, Any]) -> str:
    """Return an inconsistency of boxes, or an empty text: each leaf of the finest level needs one that is not empty."""
    boxes, start = arrays.get("leaf_box"), arrays["level_start"]
    if boxes is None:
        return ""
    if boxes.shape != (int(start[-1] - start[-2]), 3):
        return "its boxes are not as many as its finest leaves"
    if arrays["child_mask"][int(start[-2]) :].any():
        return "a box belongs to a node with children"
    for begin in range(0, len(boxes), _PIECE):
        piece = boxes[begin : begin + _PIECE]
        if (piece >> 4 < piece & 15).any():
            return "a box is empty"
    return ""


def _children_problem(start: list[int], mask: np.ndarray, first: np.ndarray) -> str:
    """Return an inconsistency of children, or an empty text: they must be consecutive, level by level.

    Runs in pieces that fit the cores' caches, to open large files quickly.
    """
    count, child = len(mask), 1
    for level in range(len(start) - 1):
        for begin in range(start[level], start[level + 1], _PIECE):
            piece = slice(begin, min(begin + _PIECE, start[level + 1]))
            children = POPCOUNT[mask[piece]]
            after = np.cumsum(children, dtype=np.uint32)
            if child + int(after[-1]) > count:
                return "its children do not add up to its nodes"
            if (((after - children + np.uint32(child)) != first[piece]) & (children > 0)).any():
                return "a child index is out of order"
            child += int(after[-1])
        if child != start[min(level + 2, len(start) - 1)]:
            return f"the children of level {level} do not add up to level {level + 1}"
    return ""
