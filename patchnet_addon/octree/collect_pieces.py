# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of leaves, collected while a surface is voxelized: fragments, with the light of both sides of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..runtime.bounds import INT32_COUNT, check_count
from ..runtime.kernels import device, kernel
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.hit_textures import HitTextures
from ..surface.mesh import MIN_OPACITY, Fragments, MeshSource, Shading, TriangleBatch
from ..surface.side_kernels import is_lit, lit_sides
from .grid import Grid
from .pieces import EXPONENT_BIAS, HOLES, LAST, MANTISSA, MOST_PIECES, NO_PIECES, TRIANGLE, Pieces

_MOST_LIGHT = 65408.0  # the largest that packed light holds
_ADVICE = "choose boxes in Surface in Voxels"


@dataclass(frozen=True, eq=False)
class LeafPieces:
    """Pieces of n leaves in their order: the count of each, uint8; triangle (p,) uint32 in the source; light (p, 2)."""

    count: np.ndarray
    triangle: np.ndarray
    light: np.ndarray


class _Found(NamedTuple):
    """Pieces of some fragments: keys (p,) uint64 of their leaves, triangle and light as in `LeafPieces`."""

    keys: np.ndarray
    triangle: np.ndarray
    light: np.ndarray


class _Leaves(NamedTuple):
    """Leaves: (n,) int64 the end of each one's pieces, and their count; (n,) uint8 how many are there already."""

    ends: np.ndarray
    counts: np.ndarray
    filled: np.ndarray


class PieceCollector:
    """Pieces of the leaves of one level of a share."""

    def __init__(self) -> None:
        self._parts: list[_Found] = []

    def add(self, batch: TriangleBatch, fragments: Fragments, shading: Shading, base: np.ndarray) -> None:
        """Add fragments with their light, and their base (F, 1 or 4), see `base_of_fragments`."""
        room = len(fragments)
        found = _Found(np.empty(room, np.uint64), np.empty(room, np.uint32), np.empty((room, 2), np.uint32))
        own = shading.arrays._replace(sides=shading.lights)
        count = _collect(fragments.keys, fragments.triangle, own, base, batch.first_triangle, found)
        self._parts.append(_Found(*(column[:count] for column in found)))

    def take(self, leaves: np.ndarray) -> LeafPieces:
        """Pieces of leaves with ascending keys (n,), which are all that have any; of a leaf, ordered by triangle."""
        rows = [np.searchsorted(leaves, part.keys) for part in self._parts]
        count = np.zeros(len(leaves), np.int64)
        for part in rows:
            count += np.bincount(part, minlength=len(leaves))
        count[count > MOST_PIECES] = 0
        room = _Leaves(np.cumsum(count), count, np.zeros(len(leaves), np.uint8))
        pieces = LeafPieces(
            count.astype(np.uint8), np.empty(count.sum(), np.uint32), np.empty((count.sum(), 2), np.uint32)
        )
        while self._parts:
            _place(rows.pop(), self._parts.pop(), room, pieces.triangle, pieces.light)
        return pieces


@kernel
def _collect(keys, triangle, shading, base, first_triangle, found):
    """Write key, triangle in the source and packed light of opaque fragments; returns how many there are."""
    count = 0
    for f in range(len(keys)):
        if not shading.opacity[f] >= MIN_OPACITY:
            continue
        found.keys[count], found.triangle[count] = keys[f], first_triangle + triangle[f]
        lit = lit_sides(shading.lit, triangle[f])
        for side in range(2):
            shown = side if is_lit(lit, side) else 1 - side
            light = shading.sides[f, min(shown, shading.sides.shape[1] - 1)]
            found.light[count, side] = _packed(light, base[f])
        count += 1
    return count


@device
def _packed(light, base):
    """Packed light that gives `light` when a base multiplies it.

    light, base: (1,) luminance, or (4,) with red, green and blue, which are scaled to the luminance.
    """
    if len(base) == 1:
        red = green = blue = float(light[0]) / float(base[0])
    else:
        own = RED * light[1] + GREEN * light[2] + BLUE * light[3]
        scale = float(light[0]) / own if own > 0.0 else 0.0
        red, green, blue = scale * light[1] / base[1], scale * light[2] / base[2], scale * light[3] / base[3]
    return packed_light(red, green, blue)


@device
def packed_light(red, green, blue):
    """Linear red, green and blue in 32 bits; negative ones and NaN are black."""
    red = min(red, _MOST_LIGHT) if red > 0.0 else 0.0
    green = min(green, _MOST_LIGHT) if green > 0.0 else 0.0
    blue = min(blue, _MOST_LIGHT) if blue > 0.0 else 0.0
    _, exponent = math.frexp(max(red, green, blue))
    exponent = min(max(exponent, -EXPONENT_BIAS), 31 - EXPONENT_BIAS)
    scale = math.ldexp(MANTISSA, -exponent)
    if np.rint(max(red, green, blue) * scale) >= MANTISSA:  # rounded up to the next power of two
        exponent += 1
        scale *= 0.5
    steps = (
        np.int64(np.rint(red * scale)) | np.int64(np.rint(green * scale)) << 9 | np.int64(np.rint(blue * scale)) << 18
    )
    return np.uint32(steps | (exponent + EXPONENT_BIAS) << 27)


@kernel
def _place(rows, found, leaves, triangle, light):
    """Insert pieces into their leaves; those of a leaf stay ordered by triangle."""
    for i in range(len(rows)):
        row = rows[i]
        if leaves.counts[row] == 0:
            continue
        first = leaves.ends[row] - leaves.counts[row]
        at = first + leaves.filled[row]
        while at > first and triangle[at - 1] > found.triangle[i]:
            triangle[at], light[at, 0], light[at, 1] = triangle[at - 1], light[at - 1, 0], light[at - 1, 1]
            at -= 1
        triangle[at], light[at, 0], light[at, 1] = found.triangle[i], found.light[i, 0], found.light[i, 1]
        leaves.filled[row] += 1


def _uvs(batch: TriangleBatch, mine: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (t, 8) float32 as in `Pieces` of some of a batch's triangles, with corners (t, 3, 3) in the cube."""
    uvs = batch.uvs[mine]
    sides, edges = (uvs[:, 1:] - uvs[:, :1]).astype(np.float64), places[:, 1:] - places[:, :1]
    there = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    scale = 0.5 * np.log2(np.clip(there / np.maximum(area, 1e-30), 1e-30, 1e30))
    return np.concatenate([uvs.reshape(-1, 6), scale[:, None], batch.materials[mine, None]], axis=1).astype(np.float32)


def joined_pieces(
    parts: Sequence[LeafPieces],
    first_child: np.ndarray,
    leaf: np.ndarray,
    source: MeshSource,
    grid: Grid,
    textures: HitTextures,
) -> Pieces:
    """Pieces of all leaves, of parts in the order of leaves; writes the first piece of each to `first_child`.

    leaf: (n,) bool, nodes that are leaves.
    """
    count = np.concatenate([part.count for part in parts])
    number = np.concatenate([part.triangle for part in parts])
    light = np.concatenate([part.light for part in parts])
    check_count(len(number), INT32_COUNT, "pieces of the surface", _ADVICE)
    ends = np.cumsum(count, dtype=np.int64)
    first_child[leaf] = np.where(count > 0, (ends - count).astype(np.uint32), NO_PIECES)
    used = np.zeros(source.triangle_count, bool)
    used[number] = True
    rows = np.cumsum(used, dtype=np.int64) - 1
    corners, uvs = [], []
    for batch in source.batches():
        mine = used[batch.first_triangle : batch.first_triangle + len(batch)]
        places = grid.to_unit(batch.corners_world[mine])
        corners.append(places.reshape(-1, 9).astype(np.float32))
        uvs.append(_uvs(batch, mine, places))
    check_count(int(used.sum()), int(TRIANGLE), "triangles in leaves", _ADVICE)
    values = np.concatenate(uvs)
    triangle = rows[number].astype(np.uint32)
    triangle[textures.materials["holes"][values[triangle, 7].astype(np.int64)] > 0] |= HOLES
    triangle[ends[count > 0] - 1] |= LAST
    return Pieces(triangle, light, np.concatenate(corners), values, textures)
