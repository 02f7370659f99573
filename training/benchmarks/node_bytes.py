# SPDX-License-Identifier: GPL-3.0-or-later
"""Bytes per node and per voxel (leaf) of an octree, field by field, in memory and on disk, beside published ones.

Compared is: L&K's sparse voxel octree (methods 4.2) takes about 5 bytes a voxel, where every node but the root
is a voxel: about 1 for the hierarchy, 1 for the contour, 1 for colour and the rest for the normal. These are the same
things that ours stores, where boxes of leaves stand for contours, beside the exact area; so bytes per node of all
fields are compared. The Bistro figures (methods 4.4) are geometry alone, per leaf, and stand beside our hierarchy per
leaf. Morton keys, which encoding computes when it needs them (8 bytes a node), and codes are not counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...patchnet_addon.octree.file import load_octree, octree_arrays
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.files import read_header
from .tables import markdown_table
from .timing import Comparison

BAR = 16.0  # bytes per node that all fields together may take


@dataclass(frozen=True)
class Published:
    """Bytes of another program; unit: what they are counted per."""

    name: str
    contents: str
    bytes: float
    unit: str
    source: str


PEER = Published("L&K's ESVO", "hierarchy, contour, colour, normal", 5.0, "node", "methods 4.2, second-hand")
PUBLISHED = (
    Published("L&K's ESVO", "hierarchy", 1.0, "node", "methods 4.2, second-hand"),
    PEER,
    Published("ESVO, Bistro 8k", "geometry", 1.02, "leaf", "methods 4.4"),
    Published("sparse 64-tree, Bistro 8k", "geometry", 0.62, "leaf", "methods 4.4"),
)
HIERARCHY = ("child_mask", "first_child")


def measure_bytes(path: Path) -> Comparison:
    """Bytes of the octree file `path` and of the octree that opening it gives; raises OctreeFileError."""
    octree = load_octree(path)
    in_memory = {name: int(array.nbytes) for name, array in octree_arrays(octree).items()}
    on_disk = {name: _size(*kind) for name, kind in read_header(path).arrays.items()}
    on_disk["header"] = path.stat().st_size - sum(on_disk.values())
    fields = [_field(name, in_memory.get(name, 0), on_disk[name], octree) for name in (*in_memory, "header")]
    total = _field("all", sum(in_memory.values()), path.stat().st_size, octree)
    ours = max(total["memory_per_node"], total["disk_per_node"])
    details = {
        "nodes": octree.node_count,
        "leaves": octree.leaf_count,
        "depth": octree.depth,
        "bar": BAR,
        "within_bar": ours <= BAR,
        "peer_name": PEER.name,
        "compared": f"bytes per node of all fields; the peer's: {PEER.contents} ({PEER.source})",
        "fields": [*fields, total],
        "hierarchy_per_leaf": sum(in_memory[name] for name in HIERARCHY) / octree.leaf_count,
        "hierarchy_per_node": sum(in_memory[name] for name in HIERARCHY) / octree.node_count,
        "published": [vars(other) for other in PUBLISHED],
    }
    return Comparison("nodes", ours, PEER.bytes, PEER.bytes / ours, details, unit="B")


def _size(dtype: Any, shape: tuple[int, ...]) -> int:
    return math.prod(shape) * int(dtype.itemsize)


def _field(name: str, memory: int, disk: int, octree: Octree) -> dict[str, Any]:
    return {
        "field": name,
        "memory_per_node": memory / octree.node_count,
        "disk_per_node": disk / octree.node_count,
        "memory_per_leaf": memory / octree.leaf_count,
        "disk_per_leaf": disk / octree.leaf_count,
    }


def bytes_tables(values: dict[str, Any]) -> str:
    """Two Markdown tables: our fields, and ours beside what others published."""
    columns = ("memory_per_node", "memory_per_leaf", "disk_per_node", "disk_per_leaf")
    head = ["field", "memory, B per node", "B per voxel", "disk, B per node", "B per voxel"]
    ours = markdown_table(head, [[row["field"], *(f"{row[c]:.2f}" for c in columns)] for row in values["fields"]])
    total = values["fields"][-1]
    colour = ", colour" if any(row["field"] == "chroma" for row in values["fields"]) else ""
    rows: list[list[object]] = [
        ["PatchNet", "hierarchy", f"{values['hierarchy_per_node']:.2f}", f"{values['hierarchy_per_leaf']:.2f}", ""],
        ["PatchNet", f"hierarchy, area, luminance, normal{colour}", f"{total['memory_per_node']:.2f}",
         f"{total['memory_per_leaf']:.2f}", ""],
    ]  # fmt: skip
    for other in values["published"]:
        cells = [f"{other['bytes']:.2f}" if other["unit"] == unit else "" for unit in ("node", "leaf")]
        rows.append([other["name"], other["contents"], *cells, other["source"]])
    return f"{ours}\n\n{markdown_table(['octree', 'holds', 'B per node', 'B per voxel', 'source'], rows)}"
