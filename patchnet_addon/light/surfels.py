# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfels: the few pieces of surface whose light is baked, chosen among the fragments of an octree (methods 7.2g).

A light cell is a cell of the octree, the face that the lit side of a surface points to most, and the side of the sheet
that it lies on, so that floor and wall, tile and what lies under it, and the two sides of a wall never mix.
Cells in leaves that cameras see have the size that their pixels need; others are coarse. A cell has one surfel: the
fragment that wins a lottery by area. Numbers of the lottery are hashes of the fragments, so that the choice depends
neither on their order, nor on cameras that see other leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..cells.hashing import entered_row, fill_slots, mixed, row_of_key, slots_for
from ..octree.blocks import CellSet
from ..octree.voxelize import ClippedSurface, on_all_cores
from ..runtime.kernels import device, kernel
from ..runtime.progress import Progress, Steps
from ..surface.mesh import MIN_OPACITY, ShadingFn, TriangleBatch
from ..surface.side_kernels import is_lit
from ..surface.sides import FRONT
from ..tracing.camera import PERSPECTIVE, Camera
from .seen_cells import ABOVE_LEAVES, LEVEL_BITS, SeenCells
from .sheets import Sheets

COARSE = 4  # levels of light cells above the leaves, where no camera looks
MOST_SHEETS = 4  # sides of sheets of a cell and face; others have their mean light
# Units of area in the face of a light cell. Whole numbers of them, up to 8192 layers, add up to the same in any order.
_FACE_UNITS = 2.0**40
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
    position and 1, or direction to the eye and 0; units (L,) of area of a light cell of each level. is_color: cells are
    of base colours.
    """

    cells: np.ndarray
    level: np.ndarray
    pixels: np.ndarray
    slots: np.ndarray
    coarsest: int
    eyes: np.ndarray
    units: np.ndarray
    is_color: bool


class _Surface(NamedTuple):
    """Triangles of a batch: number of the first; corners (T, 3, 3), normals (T, 3), and their sheets."""

    first: int
    corners_world: np.ndarray
    normals: np.ndarray
    sheets: Sheets


def eyes_of(cameras: list[Camera] | tuple[Camera, ...]) -> np.ndarray:
    """Eyes (E, 4) float64 of cameras: position and 1, or for parallel rays the direction to the eye and 0."""
    rows = [
        (*camera.position_world, 1.0) if camera.kind == PERSPECTIVE else (*-np.asarray(camera.forward), 0.0)
        for camera in cameras
    ]
    return np.array(rows, np.float64).reshape(-1, 4)


def choose_surfels(
    clipped: ClippedSurface,
    opacity: ShadingFn,
    sheets: Sheets,
    seen: SeenCells,
    eyes: np.ndarray,
    *,
    is_color: bool = False,
) -> Steps[np.ndarray]:
    """Surfels (N,) SURFEL of a surface, in the order of their light cells.

    opacity: of the lit surface; it is called in threads. seen: by cameras with `eyes` (E, 4); without eyes every side
    that gets light is seen. is_color: surfels of base colours, which vary faster than light: cells are leaves. Rays of
    cameras skip leaves that are smaller than pixels; for these there are cells of all larger sizes, too.
    """
    slots = slots_for(len(seen.cells))
    fill_slots(slots, seen.cells, np.arange(len(seen.cells)))
    coarsest = int((seen.cells & np.uint64((1 << LEVEL_BITS) - 1)).min(initial=(1 << LEVEL_BITS) - 1))
    cell_side = clipped.grid.side_world / 2.0 ** np.arange(clipped.grid.depth + 1)
    view = _View(*seen, slots, coarsest, eyes, _FACE_UNITS / cell_side**2, is_color)
    count, cores = clipped.source.triangle_count, [_draw_with_room(1 << 16) for _ in max(clipped.passes, key=len)]
    for number, ranges in enumerate(clipped.passes):
        shares = [
            _Share(clipped, index, blocks.cells(), opacity, sheets, view, draw)
            for index, (blocks, draw) in enumerate(zip(ranges, cores, strict=False), number * len(ranges))
        ]
        for done in on_all_cores(shares, clipped.source):
            yield Progress(number * count + done, len(clipped.passes) * count, LABEL)
        cores[: len(shares)] = [share.draw for share in shares]
    draw = _draw_with_room(1 << 16)
    for other in cores:
        first = 0
        while first < other.used[0]:
            first = _join(first, other, draw)
            if first < other.used[0]:
                draw = _larger(draw)
    rows = draw.rows[: int(draw.used[0])]
    rows["share"] /= view.units[(rows["cell"] & np.uint64((1 << LEVEL_BITS) - 1)).astype(np.int64)]
    return _capped(rows)


@dataclass(eq=False)
class _Share:
    """Lottery of one core over the cells of its blocks; number, cells: as of `ClippedSurface.fragments`."""

    clipped: ClippedSurface
    number: int
    cells: dict[int, CellSet]
    opacity: ShadingFn
    sheets: Sheets
    view: _View
    draw: _Draw

    def add(self, batch: TriangleBatch, areas_world: np.ndarray, normals: np.ndarray) -> None:
        """Enter a batch of triangles with areas (T,) and unit normals (T, 3)."""
        surface = _Surface(batch.first_triangle, batch.corners_world, normals, self.sheets.of(batch))
        for fragments in self.clipped.fragments(self.number, batch, areas_world, self.cells):
            shown = self.opacity(batch, fragments).opacity
            first = 0
            while first < len(fragments):
                first = _choose(first, fragments.arrays, shown, fragments.level, surface, self.view, self.draw)
                if first < len(fragments):
                    self.draw = _larger(self.draw)


def _draw_with_room(room: int) -> _Draw:
    return _Draw(np.zeros(room, SURFEL), np.zeros(room, np.uint64), slots_for(room), np.zeros(1, np.int64))


def _larger(draw: _Draw) -> _Draw:
    larger, used = _draw_with_room(2 * len(draw.rows)), int(draw.used[0])
    larger.rows[:used], larger.keys[:used] = draw.rows[:used], draw.keys[:used]
    fill_slots(larger.slots, larger.keys, np.arange(used))
    return larger._replace(used=draw.used)


@kernel
def _choose(first, fragments, shown, level, surface, view, draw):
    """Enter fragments from `first` on with opacities `shown`; returns the first without room, or their number."""
    coarse = min(COARSE, level)
    for f in range(first, len(fragments.keys)):
        if draw.used[0] + 2 * (COARSE + 1) > len(draw.rows):
            return f
        weight = fragments.area_world[f] * shown[f]
        if not shown[f] >= MIN_OPACITY or not weight > 0.0:
            continue
        t = fragments.triangle[f]
        key = fragments.keys[f]
        up, pixels = _light_level(view, key, level)
        for side in range(2):
            if not is_lit(surface.sheets.lit[t], side):
                continue
            shows = pixels if pixels > 0.0 and _is_shown(fragments, f, surface, view.eyes, side) else 0.0
            if shows > 0.0:
                for fine in range(up, coarse if view.is_color else min(up + 1, coarse)):
                    _enter(fragments, f, weight, (level, fine, shows, view.units[level - fine]), side, surface, draw)
            shows = shows if up == coarse else 0.0
            _enter(fragments, f, weight, (level, coarse, shows, view.units[level - coarse]), side, surface, draw)
    return len(fragments.keys)


@device
def _light_level(view, key, level):
    """Levels between a leaf and its light cell, and pixels that show it, 0 if no camera does.

    A coarse cell, if pixels need still larger ones, shows its share of them.
    """
    coarse = min(COARSE, level)
    for up in range(level - view.coarsest + 1):
        cell = ((key >> np.uint64(3 * up)) << np.uint64(LEVEL_BITS)) | np.uint64(level - up)
        row = row_of_key(view.slots, view.cells, cell)
        if row >= 0:
            if view.is_color:
                return min(up, coarse), float(view.pixels[row])
            wanted = max(level - view.level[row], min(ABOVE_LEAVES, level))
            return min(wanted, coarse), float(view.pixels[row]) * 0.25 ** max(wanted - coarse, 0)
    return coarse, 0.0


@device
def _is_shown(fragments, f, surface, eyes, side):
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
def side_of_sheet(sheet, side):
    """Number of a side of a sheet: of a thin wall, the back of one leaf may face as the front of the other does."""
    return np.int64(2 * sheet + side)


@device
def _enter(fragments, f, weight, where, side, surface, draw):
    """Enter a side of a fragment into the lottery of its light cell.

    where: level of the leaf, levels up to the light cell, pixels that show it, and units of a world unit of area there.
    """
    level, up, pixels, units = where
    t, key = fragments.triangle[f], fragments.keys[f]
    face = np.int64(surface.sheets.face[t]) ^ side
    cell = ((key >> np.uint64(3 * up)) << np.uint64(LEVEL_BITS)) | np.uint64(level - up)
    sheet = side_of_sheet(surface.sheets.sheet[t], side)
    place = mixed(mixed(cell, face), sheet)
    number = surface.first + t
    fragment = mixed(mixed(mixed(key, level), number), side)
    # The first of exponential arrivals, of a rate that is the weight: each wins with a chance in proportion to it.
    rank = np.float32(-np.log((np.float64(fragment >> np.uint64(11)) + 0.5) / 2.0**53) / weight)
    drawn = draw.rows[_row_of(place, draw)]
    drawn.share += np.ceil(weight * units)
    drawn.pixels = max(drawn.pixels, np.float32(pixels))
    identity = mixed(place, fragment)
    if rank < drawn.rank or (rank == drawn.rank and identity < drawn.id):
        drawn.rank, drawn.id, drawn.cell, drawn.triangle = rank, identity, cell, number
        drawn.leaf = (key << np.uint64(LEVEL_BITS)) | np.uint64(level)
        drawn.area = np.float32(fragments.area_world[f])
        drawn.one, drawn.two = fragments.barycentric[f, 0], fragments.barycentric[f, 1]
        drawn.sheet, drawn.face, drawn.side = sheet, np.uint8(face), np.uint8(side)


@device
def _row_of(place, draw):
    """Row of the light cell of a key."""
    before = draw.used[0]
    row = entered_row(draw.slots, draw.keys, draw.used, place)
    if row == before:
        draw.rows[row].rank, draw.rows[row].id = np.float32(np.inf), _LAST  # also ranks may be infinite
    return row


@kernel
def _join(first, other, draw):
    """Join another lottery to `draw`, from its row `first` on; returns the first row without room, or their number."""
    for row in range(first, other.used[0]):
        if draw.used[0] == len(draw.rows):
            return row
        mine = _row_of(other.keys[row], draw)
        drawn, rival = draw.rows[mine], other.rows[row]
        share, pixels = drawn.share + rival.share, max(drawn.pixels, rival.pixels)
        if rival.rank < drawn.rank or (rival.rank == drawn.rank and rival.id < drawn.id):
            draw.rows[mine] = rival
        drawn.share, drawn.pixels = share, pixels
    return other.used[0]


def _capped(rows: np.ndarray) -> np.ndarray:
    """Surfels of few sheets of each cell and face, those that the lottery drew first, in order."""
    order = np.lexsort((rows["id"], rows["rank"], rows["face"], rows["cell"]))
    rows = rows[order]
    changed = np.ones(len(rows), bool)
    changed[1:] = (rows["cell"][1:] != rows["cell"][:-1]) | (rows["face"][1:] != rows["face"][:-1])
    start = np.flatnonzero(changed)
    place = np.arange(len(rows)) - np.repeat(start, np.diff(np.append(start, len(rows))))
    return rows[place < MOST_SHEETS]
