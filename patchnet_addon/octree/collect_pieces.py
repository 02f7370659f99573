# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of leaves, collected while a surface is voxelized: fragments, with the light of both sides of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..cells.hashing import fill_slots, row_of_key, slots_for
from ..runtime.bounds import INT32_COUNT, check_count
from ..runtime.kernels import device, kernel
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.hit_textures import HitTextures
from ..surface.mesh import Fragments, MeshSource, TriangleBatch
from .accumulate import MIN_OPACITY
from .grid import Grid
from .pieces import EXPONENT_BIAS, HOLES, LAST, MANTISSA, MOST_PIECES, NO_PIECES, TRIANGLE, Pieces

_MOST_LIGHT = 65408.0  # the largest that packed light holds
_BOTH = np.empty(0, np.int8)
_ADVICE = "choose boxes in Surface in Voxels"


@dataclass(frozen=True, eq=False)
class LeafPieces:
    """Pieces of n leaves in their order: the count of each, uint8; triangle (p,) uint32 in the source; light (p, 2)."""

    count: np.ndarray
    triangle: np.ndarray
    light: np.ndarray


class PieceCollector:
    """Pieces of the leaves of one level of a share."""

    def __init__(self) -> None:
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def add(
        self,
        batch: TriangleBatch,
        fragments: Fragments,
        shaded: Sequence[np.ndarray],
        base: np.ndarray,
        *,
        facing: np.ndarray | None,
    ) -> None:
        """Add fragments with what their `ShadingFn` returned, and their base (F, 1 or 4), see `base_of_fragments`.

        facing: (T,) int8, lit side of a triangle, whose light both sides have; None: no side differs.
        """
        luminance, opacity, *more = shaded
        if len(more) < 2:  # both sides have one light
            lights = np.concatenate([luminance[:, None], *more], axis=1)[:, None]
        else:
            lights = more[1]
        triangle = np.empty(len(fragments), np.uint32)
        keys, light = np.empty(len(fragments), np.uint64), np.empty((len(fragments), 2), np.uint32)
        given = np.asarray(opacity, np.float32), np.asarray(lights, np.float32), base
        sides = _BOTH if facing is None else facing
        count = _collect(
            fragments.keys, fragments.triangle, given, sides, batch.first_triangle, (keys, triangle, light)
        )
        self._parts.append((keys[:count], triangle[:count], light[:count]))

    def take(self, leaves: np.ndarray) -> LeafPieces:
        """Pieces of leaves with ascending keys (n,), which are all that have any; of a leaf, ordered by triangle."""
        slots = slots_for(len(leaves))
        fill_slots(slots, leaves, np.arange(len(leaves)))
        rows = [_rows_of(keys, leaves, slots) for keys, _, _ in self._parts]
        count = np.zeros(len(leaves), np.int64)
        for part in rows:
            count += np.bincount(part, minlength=len(leaves))
        count[count > MOST_PIECES] = 0
        ends = np.cumsum(count)
        triangle, light = np.empty(count.sum(), np.uint32), np.empty((count.sum(), 2), np.uint32)
        filled = np.zeros(len(leaves), np.uint8)
        while self._parts:
            _, numbers, lights = self._parts.pop()
            _place(rows.pop(), numbers, lights, (ends, count, filled), triangle, light)
        return LeafPieces(count.astype(np.uint8), triangle, light)


@kernel
def _collect(keys, triangle, given, facing, first_triangle, out):  # type: ignore[no-untyped-def]
    """Write key, triangle in the source and packed light of opaque fragments; returns how many there are."""
    opacity, lights, base = given
    count = 0
    for f in range(len(keys)):
        if not opacity[f] >= MIN_OPACITY:
            continue
        out[0][count], out[1][count] = keys[f], first_triangle + triangle[f]
        way = facing[triangle[f]] if len(facing) else 0
        for side in range(2):
            lit = side if way == 0 else (0 if way > 0 else 1)
            out[2][count, side] = _packed(lights[f, min(lit, lights.shape[1] - 1)], base[f])
        count += 1
    return count


@device
def _packed(light, base):  # type: ignore[no-untyped-def]
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
def packed_light(red, green, blue):  # type: ignore[no-untyped-def]
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
def _rows_of(keys, leaves, slots):  # type: ignore[no-untyped-def]
    rows = np.empty(len(keys), np.int32)
    row = np.int64(0)
    for i in range(len(keys)):
        if i == 0 or keys[i] != keys[i - 1]:
            row = row_of_key(slots, leaves, keys[i])
        rows[i] = row
    return rows


@kernel
def _place(rows, numbers, lights, leaves, triangle, light):  # type: ignore[no-untyped-def]
    """Insert pieces into their leaves, whose pieces end before `ends`; those of a leaf stay ordered by triangle."""
    ends, count, filled = leaves
    for i in range(len(rows)):
        row = rows[i]
        if count[row] == 0:
            continue
        first = ends[row] - count[row]
        at = first + filled[row]
        while at > first and triangle[at - 1] > numbers[i]:
            triangle[at], light[at, 0], light[at, 1] = triangle[at - 1], light[at - 1, 0], light[at - 1, 1]
            at -= 1
        triangle[at], light[at, 0], light[at, 1] = numbers[i], lights[i, 0], lights[i, 1]
        filled[row] += 1


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
