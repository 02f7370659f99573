# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfels: the few pieces of surface whose light is baked, chosen among the fragments of an octree (methods 7.2g).

A light cell is a cell of the octree, the face of the cube that the lit side of a surface faces most, and the side of
the sheet that it lies on, so that floor and wall, tile and what lies under it, and the two sides of a wall never mix.
Cells in leaves that cameras see have the size that their pixels need; others are coarse. A cell has one surfel: the
fragment that wins a lottery by area. Numbers of the lottery are hashes of the fragments, so that the choice depends
neither on their order, nor on cameras that see other leaves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.hashing import fill_slots, mixed, row_of_key, slots_for
from ..octree.voxelize import ClippedSurface, triangle_areas_and_normals
from ..runtime.kernels import device, kernel
from ..runtime.progress import Progress, Steps
from ..surface.mesh import ShadingFn
from ..tracing.camera import PERSPECTIVE, Camera
from .seen_cells import ABOVE_LEAVES, LEVEL_BITS, SeenCells
from .sheets import Sheets

COARSE = 4  # levels of light cells above the leaves, where no camera looks
MOST_SHEETS = 4  # sides of sheets of a cell and face; others have their mean light
FRONT, BACK = 0, 1
_MIN_OPACITY = 1.0 / 255.0
_LAST = np.uint64(2**64 - 1)
LABEL = "Choosing surfels"

# A surfel: the hash of its light cell and fragment; its light cell, as in `SeenCells`, with face and side of a sheet;
# its leaf; its triangle among all of the surface, and side; place, weights of corners 1 and 2; area in world units of
# its fragment, and `share`, of all that it stands for, times opacity; pixels that show its cell, 0 if none does.
SURFEL = np.dtype(
    [
        ("id", "u8"), ("cell", "u8"), ("leaf", "u8"), ("triangle", "i8"), ("share", "f8"), ("rank", "f4"),
        ("area", "f4"), ("one", "f4"), ("two", "f4"), ("pixels", "f4"), ("sheet", "i4"), ("face", "u1"), ("side", "u1"),
    ],
    align=True,
)  # fmt: skip


class _Draw(NamedTuple):
    """Lottery so far: rows (n,) SURFEL, of which `used` (1,) are taken, the keys (n,) uint64 of their cells, and the
    slots of these.
    """

    rows: np.ndarray
    keys: np.ndarray
    slots: np.ndarray
    used: np.ndarray


class _View(NamedTuple):
    """What cameras see: `SeenCells` with slots, and the coarsest level of a voxel that a ray ends in; eyes (E, 4):
    position and 1, or direction to the eye and 0.
    """

    cells: np.ndarray
    level: np.ndarray
    pixels: np.ndarray
    slots: np.ndarray
    coarsest: int
    eyes: np.ndarray


class _Surface(NamedTuple):
    """Triangles of a batch: number of the first; corners (T, 3, 3), normals (T, 3); sheet, facing and face (T,)."""

    first: int
    corners_world: np.ndarray
    normals: np.ndarray
    sheet: np.ndarray
    facing: np.ndarray
    face: np.ndarray


def eyes_of(cameras: list[Camera] | tuple[Camera, ...]) -> np.ndarray:
    """Eyes (E, 4) float64 of cameras: position and 1, or for parallel rays the direction to the eye and 0."""
    rows = [
        (*camera.position_world, 1.0) if camera.kind == PERSPECTIVE else (*-np.asarray(camera.forward), 0.0)
        for camera in cameras
    ]
    return np.array(rows, np.float64).reshape(-1, 4)


def choose_surfels(
    clipped: ClippedSurface, opacity: ShadingFn, sheets: Sheets, seen: SeenCells, eyes: np.ndarray
) -> Steps[np.ndarray]:
    """Surfels (N,) SURFEL of a surface, in the order of their light cells.

    opacity: of the lit surface. seen: by cameras with `eyes` (E, 4); without eyes every side that gets light is seen.
    """
    slots = slots_for(len(seen.cells))
    fill_slots(slots, seen.cells, np.arange(len(seen.cells)))
    coarsest = int((seen.cells & np.uint64((1 << LEVEL_BITS) - 1)).min(initial=(1 << LEVEL_BITS) - 1))
    view = _View(*seen, slots, coarsest, eyes)
    room = 1 << 16
    draw = _Draw(np.zeros(room, SURFEL), np.zeros(room, np.uint64), slots_for(room), np.zeros(1, np.int64))
    count = clipped.source.triangle_count
    before, normals = -1, np.empty((0, 3))
    for batch, fragments in clipped.parts():
        here = slice(batch.first_triangle, batch.first_triangle + len(batch))
        if batch.first_triangle != before:
            before, normals = batch.first_triangle, triangle_areas_and_normals(batch.corners_world)[1]
        own = Sheets(*(column[here] for column in sheets))
        surface = _Surface(batch.first_triangle, batch.corners_world, normals, *own)
        shown = opacity(batch, fragments)[1]
        first = 0
        while first < len(fragments):
            first = _choose(first, fragments.arrays, shown, fragments.level, surface, view, draw)
            if first < len(fragments):
                draw = _larger(draw)
        yield Progress(here.stop, count, LABEL)
    return _capped(draw.rows[: int(draw.used[0])])


def _larger(draw: _Draw) -> _Draw:
    room = 2 * len(draw.rows)
    rows, keys, slots = np.zeros(room, SURFEL), np.zeros(room, np.uint64), slots_for(room)
    used = int(draw.used[0])
    rows[:used], keys[:used] = draw.rows[:used], draw.keys[:used]
    fill_slots(slots, keys, np.arange(used))
    return _Draw(rows, keys, slots, draw.used)


@kernel
def _choose(first, fragments, shown, level, surface, view, draw):  # type: ignore[no-untyped-def]
    """Enter fragments from `first` on with opacities `shown`; returns the first without room, or their number."""
    coarse = min(COARSE, level)
    for f in range(first, len(fragments.keys)):
        if draw.used[0] + 4 > len(draw.rows):
            return f
        weight = fragments.area_world[f] * shown[f]
        if not shown[f] >= _MIN_OPACITY or not weight > 0.0:
            continue
        t = fragments.triangle[f]
        key = fragments.keys[f]
        up, pixels = _light_level(view, key, level)
        for side in range(2):
            if (surface.facing[t] == 1 and side == BACK) or (surface.facing[t] == -1 and side == FRONT):
                continue
            shows = pixels if pixels > 0.0 and _is_shown(fragments, f, surface, view.eyes, side) else 0.0
            if up < coarse and shows > 0.0:
                _enter(fragments, f, weight, (level, up, shows), side, surface, draw)
            _enter(fragments, f, weight, (level, coarse, shows if up == coarse else 0.0), side, surface, draw)
    return len(fragments.keys)


@device
def _light_level(view, key, level):  # type: ignore[no-untyped-def]
    """Levels between a leaf and its light cell, and pixels that show it, 0 if no camera does.

    A coarse cell, if pixels need still larger ones, shows its share of them.
    """
    coarse = min(COARSE, level)
    for up in range(level - view.coarsest + 1):
        cell = ((key >> np.uint64(3 * up)) << np.uint64(LEVEL_BITS)) | np.uint64(level - up)
        row = row_of_key(view.slots, view.cells, cell)
        if row >= 0:
            wanted = max(level - view.level[row], min(ABOVE_LEAVES, level))
            return min(wanted, coarse), float(view.pixels[row]) * 0.25 ** max(wanted - coarse, 0)
    return coarse, 0.0


@device
def _is_shown(fragments, f, surface, eyes, side):  # type: ignore[no-untyped-def]
    """Return whether an eye is on that side of a fragment's plane."""
    t = fragments.triangle[f]
    one, two = float(fragments.barycentric[f, 0]), float(fragments.barycentric[f, 1])
    for e in range(len(eyes)):
        height = 0.0
        for axis in range(3):
            corner = surface.corners_world[t, 0, axis]
            place = corner + one * (surface.corners_world[t, 1, axis] - corner)
            place += two * (surface.corners_world[t, 2, axis] - corner)
            height += surface.normals[t, axis] * (eyes[e, axis] - eyes[e, 3] * place)
        if (height > 0.0) == (side == FRONT):
            return True
    return len(eyes) == 0


@device
def side_of_sheet(sheet, side):  # type: ignore[no-untyped-def]
    """Number of a side of a sheet: of a thin wall, the back of one leaf may face as the front of the other does."""
    return np.int64(2 * sheet + side)


@device
def _enter(fragments, f, weight, where, side, surface, draw):  # type: ignore[no-untyped-def]
    """Enter a side of a fragment into the lottery of its light cell.

    where: level of the leaf, levels up to the light cell, and pixels that show it.
    """
    level, up, pixels = where
    t, key = fragments.triangle[f], fragments.keys[f]
    face = np.int64(surface.face[t]) ^ side
    cell = ((key >> np.uint64(3 * up)) << np.uint64(LEVEL_BITS)) | np.uint64(level - up)
    sheet = side_of_sheet(surface.sheet[t], side)
    place = mixed(mixed(cell, face), sheet)
    number = surface.first + t
    fragment = mixed(mixed(mixed(key, level), number), side)
    # The first of exponential arrivals, of a rate that is the weight: each wins with a chance in proportion to it.
    rank = np.float32(-np.log((np.float64(fragment >> np.uint64(11)) + 0.5) / 2.0**53) / weight)
    row = row_of_key(draw.slots, draw.keys, place)
    if row < 0:
        slot = -1 - row
        row = draw.used[0]
        draw.used[0] += 1
        draw.slots[slot] = row + 1
        draw.keys[row] = place
        draw.rows[row].rank, draw.rows[row].id = np.float32(np.inf), _LAST  # also ranks may be infinite
    drawn = draw.rows[row]
    drawn.share += weight
    drawn.pixels = max(drawn.pixels, np.float32(pixels))
    identity = mixed(place, fragment)
    if rank < drawn.rank or (rank == drawn.rank and identity < drawn.id):
        drawn.rank, drawn.id, drawn.cell, drawn.triangle = rank, identity, cell, number
        drawn.leaf = (key << np.uint64(LEVEL_BITS)) | np.uint64(level)
        drawn.area = np.float32(fragments.area_world[f])
        drawn.one, drawn.two = fragments.barycentric[f, 0], fragments.barycentric[f, 1]
        drawn.sheet, drawn.face, drawn.side = sheet, np.uint8(face), np.uint8(side)


def _capped(rows: np.ndarray) -> np.ndarray:
    """Surfels of few sheets of each cell and face, those that the lottery drew first, in order."""
    order = np.lexsort((rows["id"], rows["rank"], rows["face"], rows["cell"]))
    rows = rows[order]
    changed = np.ones(len(rows), bool)
    changed[1:] = (rows["cell"][1:] != rows["cell"][:-1]) | (rows["face"][1:] != rows["face"][:-1])
    start = np.flatnonzero(changed)
    place = np.arange(len(rows)) - np.repeat(start, np.diff(np.append(start, len(rows))))
    return rows[place < MOST_SHEETS]
