# SPDX-License-Identifier: GPL-3.0-or-later
"""Sparse voxel octree: 14 bytes per node, 16 with colour, level by level, children of a node adjacent.

Its finest leaves may have boxes, three bytes each.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..cells.leaf_boxes import FILLED_STEPS, filled_steps
from ..cells.morton import POPCOUNT, morton_decode
from ..cells.scales import LUMINANCE_SCALE, NORMAL_SCALE
from ..directional.node_light import NO_HIGHLIGHTS, NO_SIDES, HdrHighlights, NodeLight, marked, sides_of
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..surface.chroma import decoded_colors
from .grid import Grid
from .pieces import NONE, Pieces


class Nodes(NamedTuple):
    """Nodes of an octree and boxes of its finest leaves, for kernels.

    child_mask: (n,) uint8, bit x + 2y + 4z set if that child exists; 0 for leaves.
    first_child: (n,) uint32, node index of the first existing child; the others follow in order of their bit.
    first_boxed: the first node with a box; all later ones have one.
    boxes: (b, 3) uint8 as `Octree.leaf_box`; without boxes, `first_boxed` is above all nodes.
    pieces, corners: triangles of pieces (p,) and their corners (t, 9) as in `Pieces`, empty for rays that end on boxes.
    """

    child_mask: np.ndarray
    first_child: np.ndarray
    first_boxed: int
    boxes: np.ndarray
    pieces: np.ndarray = NONE.triangle
    corners: np.ndarray = NONE.corners


def without_boxes(child_mask: np.ndarray, first_child: np.ndarray) -> Nodes:
    """Nodes whose leaves are whole voxels."""
    return Nodes(child_mask, first_child, len(child_mask), np.empty((0, 3), np.uint8))


def keys_below(keys: np.ndarray, child_mask: np.ndarray) -> np.ndarray:
    """Morton keys (c,) uint64, ascending, of the children of a level's nodes with keys (n,)."""
    parent, octant = np.nonzero(np.unpackbits(child_mask[:, None], axis=1, bitorder="little"))
    return (keys[parent] << np.uint64(3)) | octant.astype(np.uint64)


@dataclass(frozen=True, eq=False)
class Octree:
    """Octree of all nodes of all levels, root first; within a level in Morton order.

    level_start: (depth + 2,) int64, nodes of level l are level_start[l] to level_start[l + 1].
    child_mask: (n,) uint8, bit x + 2y + 4z set if that child exists; 0 for leaves.
    first_child: (n,) uint32, node index of the first existing child; the others follow in order of their bit. Of a
    leaf, with `pieces`: the first of its pieces, `NO_PIECES` for none.
    area_world: (n,) float32, surface in the voxel, weighed by opacity.
    luminance: (n,) uint16, mean luminance over that surface, 65535 = 1 (methods 7.1, 7.2).
    normal: (n, 3) int8, mean normal, 127 = 1, not renormalised (methods 7.2).
    chroma: (n, 2) uint8, shares of red and of blue in the mean colour over that surface, 255 = 1 (methods 7.2d); None
    without colour.
    bright_nodes, bright_colors: (b,) uint32, ascending, and (b, 3) float32: nodes with light above white, and the
    linear colour removed by the clamp (methods 7.1b); None if nothing is above white.
    leaf_box: (f, 3) uint8, boxes around the surface in the leaves of the finest level (`leaf_boxes.py`, methods 4.1d);
    None if leaves are whole voxels.
    side_nodes, side_light, side_share, side_chroma: (s,) uint32, ascending, (s, 6) and (s, 6) uint8, and in colour
    (s, 6, 2) uint8: nodes with a luminance by direction (`sides.py`); None if all have one luminance.
    pieces: triangles of leaves (`pieces.py`); None where all rays end on boxes.
    exposure: factor on luminance before it was clamped to [0, 1].
    provenance: how the octree was made (scene, light, settings, versions), plain JSON values.
    """

    grid: Grid
    level_start: np.ndarray
    child_mask: np.ndarray
    first_child: np.ndarray
    area_world: np.ndarray
    luminance: np.ndarray
    normal: np.ndarray
    chroma: np.ndarray | None = None
    bright_nodes: np.ndarray | None = None
    bright_colors: np.ndarray | None = None
    leaf_box: np.ndarray | None = None
    side_nodes: np.ndarray | None = None
    side_light: np.ndarray | None = None
    side_share: np.ndarray | None = None
    side_chroma: np.ndarray | None = None
    pieces: Pieces | None = None
    exposure: float = 1.0
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def depth(self) -> int:
        """Level of the finest leaves; the root is level 0."""
        return self.grid.depth

    @property
    def nodes(self) -> Nodes:
        """Nodes and boxes of the finest leaves, for kernels."""
        if self.leaf_box is None:
            return without_boxes(self.child_mask, self.first_child)
        return Nodes(self.child_mask, self.first_child, int(self.level_start[self.depth]), self.leaf_box)

    @property
    def exact_nodes(self) -> Nodes:
        """Nodes for rays that end on the surface where leaves have pieces."""
        if self.pieces is None:
            return self.nodes
        return self.nodes._replace(pieces=self.pieces.triangle, corners=self.pieces.corners)

    def without_pieces(self) -> Octree:
        """Return the octree with rays that end on boxes, as in the paper."""
        return replace(self, pieces=None)

    @property
    def filled(self) -> np.ndarray:
        """Share of its voxel that each node fills, (n,) uint16 in steps of 1 / FILLED_STEPS (`leaf_boxes.py`)."""
        found = np.full(self.node_count, FILLED_STEPS, np.uint16)
        if self.leaf_box is not None:
            found[self.level_start[self.depth] :] = filled_steps(self.leaf_box)
        return found

    @property
    def node_count(self) -> int:
        """Nodes of all levels, leaves included."""
        return len(self.child_mask)

    @property
    def leaf_count(self) -> int:
        """Nodes without children."""
        return int(np.count_nonzero(self.child_mask == 0))

    @property
    def nbytes(self) -> int:
        """Bytes of the node arrays and the pieces."""
        arrays = (array for name, array in vars(self).items() if name != "level_start")
        nodes = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
        return nodes + (0 if self.pieces is None else self.pieces.nbytes)

    @cached_property
    def hdr_highlights(self) -> HdrHighlights:
        """Light above white, for kernels."""
        if self.bright_nodes is None or self.bright_colors is None:
            return NO_HIGHLIGHTS
        return HdrHighlights(*marked(self.bright_nodes, self.node_count), self.bright_colors)

    @cached_property
    def light(self) -> NodeLight:
        """Luminance of nodes and of their sides, for kernels."""
        if self.side_nodes is None or self.side_light is None or self.side_share is None:
            return NodeLight(self.luminance, NO_SIDES)
        sides = sides_of(self.side_nodes, self.child_mask, self.side_light, self.side_share, self.side_chroma)
        return NodeLight(self.luminance, sides)

    def without_sides(self) -> Octree:
        """Return the octree with one luminance per node, as in the paper."""
        return replace(self, side_nodes=None, side_light=None, side_share=None, side_chroma=None)

    def level(self, level: int) -> slice:
        """Node indices of one level."""
        return slice(int(self.level_start[level]), int(self.level_start[level + 1]))

    def level_of(self, nodes: np.ndarray) -> np.ndarray:
        """Levels (N,) int32 of node indices (N,)."""
        return (np.searchsorted(self.level_start, nodes, side="right") - 1).astype(np.int32)

    def keys(self, level: int) -> np.ndarray:
        """Morton keys (n_level,) uint64 of the level's cells, ascending; computed from the root down."""
        keys = np.zeros(1, np.uint64)
        for above in range(level):
            keys = keys_below(keys, self.child_mask[self.level(above)])
        return keys

    def cells(self, level: int) -> np.ndarray:
        """Integer cells (n_level, 3) int32 of the level's nodes."""
        return morton_decode(self.keys(level))

    def look_ahead(self, lookahead: int = DEFAULT_LOOKAHEAD) -> np.ndarray:
        """(n,) bool: the node has descendants `lookahead` levels further down (methods 4.1b)."""
        has = self.child_mask > 0
        inner = np.flatnonzero(has)
        ends = np.cumsum(POPCOUNT[self.child_mask[inner]], dtype=np.int64)
        for _ in range(lookahead - 1):
            children = has[1:]  # of inner nodes, in order, are all nodes but the root
            has = np.zeros(self.node_count, bool)
            has[inner] = np.logical_or.reduceat(children, np.append(0, ends[:-1])) if len(inner) else False
        return has

    def luminance_float(self, nodes: np.ndarray | slice) -> np.ndarray:
        """Luminance in [0, 1], float32."""
        return self.luminance[nodes].astype(np.float32) / np.float32(LUMINANCE_SCALE)

    def color_float(self, nodes: np.ndarray | slice) -> np.ndarray:
        """Linear colours (N, 3) float32 whose luminance is the node's; channels may be above 1; gray without colour."""
        luminance = self.luminance_float(nodes)
        if self.chroma is None:
            return np.repeat(luminance[:, None], 3, axis=1)
        return decoded_colors(luminance, self.chroma[nodes])

    def color_above_white(self, nodes: np.ndarray) -> np.ndarray:
        """Linear colours (N, 3) float32 removed from nodes (N,) by the clamp; 0 for misses (-1)."""
        colors = np.zeros((len(nodes), 3), np.float32)
        if self.bright_nodes is not None and self.bright_colors is not None and len(self.bright_nodes):
            place = np.minimum(np.searchsorted(self.bright_nodes, nodes), len(self.bright_nodes) - 1)
            found = self.bright_nodes[place] == nodes
            colors[found] = self.bright_colors[place[found]]
        return colors

    def normal_float(self, nodes: np.ndarray | slice) -> np.ndarray:
        """Mean normals (N, 3) float32, length at most 1."""
        return self.normal[nodes].astype(np.float32) / np.float32(NORMAL_SCALE)
