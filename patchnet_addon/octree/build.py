# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree builder: leaves of triangles pass by pass, then exact means of all levels, bottom-up (methods 7.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from ..cells.leaf_boxes import WHOLE, unpacked
from ..cells.morton import POPCOUNT
from ..cells.scales import LUMINANCE_SCALE
from ..directional.leaf_sides import LeafSides, joined_sides, no_sides
from ..directional.level_sides import Level, LevelNodes, sides_of_levels
from ..runtime.errors import GeometryError
from ..runtime.progress import Steps
from ..surface.chroma import REC709, decoded_colors
from ..surface.chroma_kernels import decode_colors, encode_chroma
from ..surface.hit_textures import hit_textures
from ..surface.mesh import MeshSource, ShadingFn
from .accumulate import LeafSums, SurfaceSums
from .collect_pieces import LeafPieces, joined_pieces
from .exposure import Emitters, exposure_without_emitters
from .grid import Grid
from .leaf_levels import BLOCK_FRAGMENTS, LeafLevels
from .levels import (
    area_and_normal,
    means_of_level,
    merge_nodes,
    number_children,
    parents_of,
    sums_of_level,
)
from .octree import Octree
from .voxelize import PLAIN_LEAVES, ClippedSurface, LeafDetail, voxelize

_LEAST_ABOVE = 1.0 / 65535.0  # least stored luminance above white, the step of luminance itself


class LevelPart(NamedTuple):
    """Nodes of one level in consecutive blocks, in Morton order, in the octree's compact form.

    child_mask: (n,) uint8, area_world: (n,) float32, normal: (n, 3) int8 as in `Octree`. Of its leaves: leaf_luminance
    (l,) float32, means before exposure, leaf_chroma (l, 2) uint8, or (l, 0) without colour, leaf_box (l, 3) uint8, and
    leaf_sides, empty unless sides are stored, and leaf_pieces, None without.
    """

    child_mask: np.ndarray
    area_world: np.ndarray
    normal: np.ndarray
    leaf_luminance: np.ndarray
    leaf_chroma: np.ndarray
    leaf_box: np.ndarray
    leaf_sides: LeafSides
    leaf_pieces: LeafPieces | None


@dataclass(frozen=True, eq=False)
class Subtrees:
    """Subtrees over the leaves of some blocks of space, level by level from the blocks, of `root_level`, down.

    root_keys: (r,) uint64 of the nonempty blocks. root_area, root_normal: (r,) and (r, 3) float64, area and area *
    normal in world units. In a large scene only the leaves of one pass are held as sums; luminance is stored later,
    since the exposure needs all leaves.
    """

    root_level: int
    root_keys: np.ndarray
    root_area: np.ndarray
    root_normal: np.ndarray
    levels: tuple[LevelPart, ...]


def subtrees(leaves: Sequence[LeafSums], root_level: int) -> Subtrees:
    """Nodes over leaves that lie on one or several levels from `root_level` on, no leaf within another one."""
    by_level = {part.level: part for part in leaves}
    colored = bool(leaves) and leaves[0].sums.red_blue.shape[1] > 0
    none = LeafSums(0, np.empty(0, np.uint64), SurfaceSums.empty(0, colored=colored))
    keys, area, normal = none.keys, np.empty(0, np.float64), np.empty((0, 3), np.float64)
    levels = []
    for level in range(max(by_level, default=root_level), root_level - 1, -1):
        own = by_level.get(level, none)
        parents, mask = parents_of(keys)
        keys, mask = merge_nodes(own.keys, parents, mask)
        sums, count = own.sums, len(own.keys)
        area, normal = sums_of_level(mask, area, normal, sums.area, sums.normal)
        chroma = encode_chroma(sums.light, sums.red_blue) if colored else np.empty((count, 0), np.uint8)
        boxes = unpacked(np.full(count, WHOLE, np.uint32)) if own.boxes is None else own.boxes
        sides = own.sides or no_sides(colored=colored)
        stored = area_and_normal(area, normal)
        levels.append(LevelPart(mask, *stored, sums.light / sums.area, chroma, boxes, sides, own.pieces))
    return Subtrees(root_level, keys, area, normal, tuple(reversed(levels)))


def build_octree(
    source: MeshSource,
    grid: Grid,
    shade: ShadingFn,
    *,
    layout: LeafLevels | None = None,
    exposure: float | None = None,
    provenance: dict[str, Any] | None = None,
    block_fragments: int = BLOCK_FRAGMENTS,
    detail: LeafDetail = PLAIN_LEAVES,
) -> Steps[Octree]:
    """Voxelize `source` on `grid` with the luminance and opacity of `shade`, in colour if `shade` has colour.

    layout: levels of the leaves, at most the grid's depth; None puts all on that. Levels below the finest leaf are
    omitted. exposure: factor on luminance before it is clamped to [0, 1] at the leaves; None scales the 99.5 % quantile
    of leaf luminance to 1, without leaves with emitters (methods 7.1). Values above 1 are stored separately (methods
    7.1b). block_fragments: approximate number of fragments in memory; it does not affect the result. detail: with boxes
    rays meet structures thinner than a voxel at their place (methods 4.1d); luminance by direction is stored for nodes
    whose sides differ (`directional/`). Raises GeometryError without opaque surface.
    """
    clipped = ClippedSurface(source, grid, layout, block_fragments=block_fragments, keep_bytes=0)
    return (yield from build_clipped(clipped, shade, exposure=exposure, provenance=provenance, detail=detail))


def build_clipped(
    clipped: ClippedSurface,
    shade: ShadingFn,
    *,
    exposure: float | None = None,
    provenance: dict[str, Any] | None = None,
    detail: LeafDetail = PLAIN_LEAVES,
) -> Steps[Octree]:
    """Build the octree of a surface that may be clipped already, see `build_octree`."""
    emitters = Emitters(clipped.source)
    watch = emitters.note if exposure is None and emitters.anything else None
    parts = yield from voxelize(clipped, shade, subtrees, watch=watch, detail=detail)
    parts = [part for part in parts if len(part.root_keys)]
    if not parts:
        raise GeometryError(
            "No opaque surface is left to voxelize: all triangles have zero area or are fully transparent"
        )
    return _joined(parts, clipped, exposure, provenance or {}, emitters, detail)


def _joined(
    parts: list[Subtrees],
    clipped: ClippedSurface,
    exposure: float | None,
    provenance: dict[str, Any],
    emitters: Emitters,
    detail: LeafDetail,
) -> Octree:
    """Octree of blocks in Morton order; empties `parts` to save memory."""
    blocks = zip_longest(*(part.levels for part in parts))
    levels = [[part] for part in _above(parts)] + [[part for part in level if part] for level in blocks]
    parts.clear()
    colored, depth = levels[-1][0].leaf_chroma.shape[1] > 0, len(levels) - 1
    light, masks = _column(levels, "leaf_luminance"), _column(levels, "child_mask")
    exposure = exposure_without_emitters(masks, light, emitters) if exposure is None else float(exposure)
    areas, normals, hues = (_column(levels, name) for name in ("area_world", "normal", "leaf_chroma"))
    leaf_box = _column(levels[-1:], "leaf_box")[0] if detail.boxes else None
    side_parts = [_leaf_sides(level) for level in levels] if detail.sides else []
    piece_parts = [part.leaf_pieces for level in levels for part in level if part.leaf_pieces is not None]
    levels.clear()
    bright, above = light_hdr_highlights(masks, areas, light, hues if colored else [], exposure)
    luminance, chroma = _luminance(masks, areas, light, hues if colored else [], exposure)
    found = None
    grid = clipped.grid
    if detail.sides:
        hue = chroma if colored else [np.empty((len(mask), 0), np.uint8) for mask in masks]
        faces = [(grid.side_world / (1 << level)) ** 2 for level in range(depth + 1)]
        nodes = map(LevelNodes, masks, areas, normals, luminance, hue)
        found = sides_of_levels(list(map(Level, nodes, faces, side_parts)), exposure)
    child_mask = np.concatenate(masks)
    first_child, pieces = number_children(child_mask), None
    if detail.base is not None:
        textures = hit_textures(detail.base.table, detail.base.reflects, color=colored)
        pieces = joined_pieces(piece_parts, first_child, child_mask == 0, clipped.source, grid, textures)
    return Octree(
        grid=replace(grid, depth=depth),
        level_start=np.concatenate([[0], np.cumsum([len(mask) for mask in masks])]).astype(np.int64),
        child_mask=child_mask,
        first_child=first_child,
        area_world=_emptied(areas),
        luminance=_emptied(luminance),
        normal=_emptied(normals).reshape(-1, 3),
        chroma=_emptied(chroma) if colored else None,
        bright_nodes=bright if len(bright) else None,
        bright_colors=above if len(bright) else None,
        leaf_box=leaf_box,
        side_nodes=found.nodes if found else None,
        side_light=found.light if found else None,
        side_share=found.share if found else None,
        side_chroma=found.chroma if found and colored else None,
        pieces=pieces,
        exposure=exposure,
        provenance=provenance,
    )


def _above(parts: Sequence[Subtrees]) -> tuple[LevelPart, ...]:
    """Levels above the blocks of all parts, which are of one level."""
    keys, area, normal = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("root_keys", "root_area", "root_normal")
    )
    unlit = np.zeros(len(keys)), np.zeros((len(keys), parts[0].levels[0].leaf_chroma.shape[1]))
    whole = subtrees([LeafSums(parts[0].root_level, keys, SurfaceSums(area, unlit[0], normal, unlit[1]))], 0)
    return whole.levels[:-1]  # the blocks themselves are the parts' roots


def _leaf_sides(level: Sequence[LevelPart]) -> LeafSides:
    """Sides of a level's leaves of all parts, in order."""
    return joined_sides([part.leaf_sides for part in level], [len(part.leaf_luminance) for part in level])


def _column(levels: Sequence[Sequence[LevelPart]], name: str) -> list[np.ndarray]:
    """Concatenate one column of each level of all parts, in order."""
    return [np.concatenate([getattr(part, name) for part in level]) for level in levels]


def _luminance(
    masks: Sequence[np.ndarray],
    areas: Sequence[np.ndarray],
    light: list[np.ndarray],
    hues: list[np.ndarray],
    exposure: float,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Stored luminance of each level, bottom-up, and chroma if there are `hues`, the leaves' chroma.

    The leaves' `light` is exposed and clamped, their hue is kept; both lists are emptied.
    """
    stored: list[np.ndarray] = []
    chroma: list[np.ndarray] = []
    area, values = np.empty(0, np.float32), np.empty((0, 3 if hues else 1), np.float32)
    while light:
        level = len(light) - 1
        exposed = np.clip(light.pop() * np.float64(exposure), 0.0, 1.0).astype(np.float32)
        leaves = decode_colors(exposed, hues.pop().reshape(-1, 2)) if hues else exposed[:, None]
        values = means_of_level(masks[level], area, values, leaves)
        with np.errstate(invalid="ignore"):  # infinite areas have no mean; their objects are named later
            stored.append(np.rint(values[:, 0].astype(np.float64) * LUMINANCE_SCALE).astype(np.uint16))
        if values.shape[1] > 1:
            chroma.append(encode_chroma(values[:, 0], values[:, 1:]))
        area = areas[level]
    return stored[::-1], chroma[::-1]


def light_hdr_highlights(
    masks: Sequence[np.ndarray],
    areas: Sequence[np.ndarray],
    light: Sequence[np.ndarray],
    hues: Sequence[np.ndarray],
    exposure: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (b,) uint32, ascending, and colours (b, 3) float32 above white, of leaves and their means.

    All by level, coarse first: child masks (n,) and areas (n,) of its nodes, luminance (l,) before exposure and chroma
    (l, 2) of its leaves; `hues` is empty without colour.
    """
    first = np.cumsum([0, *(len(mask) for mask in masks)])
    nodes, colors = [], []
    index, own = np.empty(0, np.int64), np.empty((0, 3))  # of one level, within it
    for level in range(len(masks) - 1, -1, -1):
        mask = masks[level]
        inner, inner_colors = _means(mask, areas[level + 1], index, own) if len(index) else (index, own)
        leaf = np.flatnonzero(light[level] * exposure > 1.0)
        above = light[level][leaf] * exposure - 1.0
        hue = hues[level].reshape(-1, 2)[leaf] if len(hues) else None
        leaf_colors = np.repeat(above[:, None], 3, axis=1) if hue is None else decoded_colors(above, hue)
        leaf = np.flatnonzero(mask == 0)[leaf] if len(light[level]) < len(mask) else leaf
        order = np.argsort(np.concatenate([leaf, inner]))
        index = np.concatenate([leaf, inner])[order]
        own = np.concatenate([leaf_colors, inner_colors])[order]
        kept = own @ REC709.astype(np.float64) >= _LEAST_ABOVE
        nodes.append((index[kept] + first[level]).astype(np.uint32))
        colors.append(own[kept].astype(np.float32))
    return np.concatenate(nodes[::-1]), np.concatenate(colors[::-1])


def _means(mask: np.ndarray, area: np.ndarray, index: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (p,) of a level with children that have light above white, and its area-weighted means (p, 3) over them.

    mask: (n,) of the level. area: (c,) of the level below; index, own: its children (k,) with such light (k, 3).
    """
    counts = POPCOUNT[mask].astype(np.int64)
    ends = np.cumsum(counts)
    parents, inverse = np.unique(np.searchsorted(ends, index, side="right"), return_inverse=True)
    child, count = ends[parents] - counts[parents], counts[parents]
    total = np.zeros(len(parents))
    for octant in range(8):
        there = octant < count
        total[there] += area[child[there] + octant]
    sums = [np.bincount(inverse.reshape(-1), area[index] * own[:, channel], len(parents)) for channel in range(3)]
    return parents, np.stack(sums, axis=1) / total[:, None]


def _emptied(arrays: list[np.ndarray]) -> np.ndarray:
    """Concatenate all arrays and empty the list, each array right after its copy."""
    joined = np.empty((sum(len(array) for array in arrays), *arrays[0].shape[1:]), arrays[0].dtype)
    start = 0
    while arrays:
        array = arrays.pop(0)
        joined[start : start + len(array)] = array
        start += len(array)
    return joined
