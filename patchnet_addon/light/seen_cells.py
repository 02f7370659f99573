# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves that cameras see, and the light cells that their pixels need (methods 7.2g)."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..cells.morton import morton_encode
from ..lod.ray_rows import rows_apart
from ..lod.stops import FINE_OFFSETS, bands_of, ray_stops
from ..octree.grid import Grid
from ..octree.octree import Nodes
from ..runtime.bounds import DEFAULT_LOOKAHEAD, MOST_STILLS, SMALL_PX
from ..runtime.progress import Progress, Steps
from ..tracing.camera import Camera, camera_in_unit_cube

LEVEL_BITS = 5  # of a cell: its Morton key << 5 | its level
ABOVE_LEAVES = 1  # least levels of light cells above the leaves
_FINER = 2  # levels by which rays are finer than the leaves of a pixel, so that they end in leaves
_BANDS_PER_STEP = 8
_RECENT = 8  # pictures of a track whose light cells tell whether a further one sees much that is new
_KNOWN = 0.5  # share of the light cells
LABEL = "Looking where cameras look"


class SeenCells(NamedTuple):
    """Voxels that S rays end in, each once.

    cells: (S,) uint64, Morton key << 5 | level, ascending. level: (S,) int64, of the light cells that the nearest
    camera's pixels need there. pixels: (S,) float32, pixels of all cameras that show the light cell.
    """

    cells: np.ndarray
    level: np.ndarray
    pixels: np.ndarray


def cells_of(keys: np.ndarray, level: int) -> np.ndarray:
    """Cells (n,) uint64 of Morton keys (n,) of a level."""
    return (keys << np.uint64(LEVEL_BITS)) | np.uint64(level)


def all_cells(leaf_keys: Mapping[int, np.ndarray]) -> SeenCells:
    """All leaves, by level, as if cameras saw each in a pixel of its size."""
    cells = np.concatenate([cells_of(keys, level) for level, keys in leaf_keys.items()])
    levels = np.concatenate([np.full(len(keys), level, np.int64) for level, keys in leaf_keys.items()])
    order = np.argsort(cells)
    return SeenCells(cells[order], levels[order], np.ones(len(cells), np.float32))


def seen_cells(
    nodes: Nodes,
    grid: Grid,
    cameras: Sequence[Camera],
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
) -> Steps[SeenCells]:
    """Leaves in which rays of all cameras end.

    Stills have 2 x 2 rays a pixel, 4 x 4 in small pictures. With more than four cameras, which are a track, a pixel has
    one ray, or 2 x 2 pixels have one where those before show most of what a camera sees; successive cameras of a long
    track share a picture's rays (`bands_of`). lookahead: levels, of the weights in use.
    """
    found, more = _none(), []
    recent: deque[np.ndarray] = deque(maxlen=_RECENT)
    is_track = len(cameras) > MOST_STILLS
    together = rows_apart(len(cameras))
    for first in range(0, len(cameras), together):
        group = range(first, min(first + together, len(cameras)))
        if not is_track:
            camera = cameras[first]
            side, below = (4, 1) if camera.width_px * camera.height_px <= SMALL_PX else (2, 0)
            offsets = [((i + 0.5) / side - 0.5, (j + 0.5) / side - 0.5) for i in range(side) for j in range(side)]
            part = yield from _look(nodes, grid, cameras, group, offsets, lookahead, below=below)
        else:
            turn = first // together % len(FINE_OFFSETS)
            offsets = [*FINE_OFFSETS[turn:], *FINE_OFFSETS[:turn]]
            part = yield from _look(nodes, grid, cameras, group, offsets[:1], lookahead, coarser=1)
            known = np.isin(_light_cells(part), np.concatenate([np.empty(0, np.uint64), *recent]))
            if len(known) and known.mean() < _KNOWN:
                part = yield from _look(nodes, grid, cameras, group, offsets, lookahead, coarser=1)
            recent.append(_light_cells(part))
        more.append(part)
        if sum(len(part.cells) for part in more) > len(found.cells):  # so that a long track is sorted few times
            found, more = _joined([found, *more]), []
    found = _joined([found, *more])
    cells, mine = np.unique(_light_cells(found), return_inverse=True)
    mine = mine.reshape(-1)
    return found._replace(pixels=np.bincount(mine, found.pixels, len(cells))[mine].astype(np.float32))


def _look(
    nodes: Nodes,
    grid: Grid,
    cameras: Sequence[Camera],
    group: range,
    offsets: Sequence[tuple[float, float]],
    lookahead: int,
    *,
    coarser: int = 0,
    below: int = 0,
) -> Steps[SeenCells]:
    """Voxels that rays of a group of a job's cameras end in, with the cameras' pixels.

    offsets: from the centres of pixels `coarser` levels coarser than the camera's. below: level of light cells below
    that of the voxel that fits a pixel.
    """
    parts = [_none()]
    for number in group:
        camera = cameras[number]
        width, height = (max(side >> coarser, 1) for side in (camera.width_px, camera.height_px))
        unit = camera_in_unit_cube(camera.with_size(width, height), grid)
        bands = bands_of(number, len(cameras), height)
        share = camera.width_px * camera.height_px / (width * height * len(offsets)) * bands.step
        for first in range(0, len(bands), _BANDS_PER_STEP):
            some = bands[first : first + _BANDS_PER_STEP]
            for offset in offsets:
                stops = ray_stops(nodes, unit, some, offset, lookahead + coarser + _FINER, lookahead)
                hit = np.flatnonzero(stops.wanted > 0)
                keys = morton_encode(stops.cell[hit])
                cells = (keys << np.uint64(LEVEL_BITS)) | stops.level[hit].astype(np.uint64)
                level = stops.wanted[hit].astype(np.int64) - lookahead + coarser + below
                parts.append(SeenCells(cells, level, np.full(len(hit), share, np.float32)))
            yield Progress(number + (first + len(some)) / len(bands), len(cameras), LABEL)
    return _joined(parts)


def _light_cells(seen: SeenCells) -> np.ndarray:
    """Light cells (S,) uint64 around voxels."""
    level = (seen.cells & np.uint64((1 << LEVEL_BITS) - 1)).astype(np.int64)
    up = np.maximum(level - seen.level, np.minimum(ABOVE_LEAVES, level)).astype(np.uint64)
    keys = (seen.cells >> np.uint64(LEVEL_BITS)) >> (np.uint64(3) * up)
    return (keys << np.uint64(LEVEL_BITS)) | (level.astype(np.uint64) - up)


def _none() -> SeenCells:
    return SeenCells(np.empty(0, np.uint64), np.empty(0, np.int64), np.empty(0, np.float32))


def _joined(parts: Sequence[SeenCells]) -> SeenCells:
    """All cells of several, each once: the finest level, the sum of the pixels."""
    cells, level, pixels = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.argsort(cells, kind="stable")
    first = np.flatnonzero(np.diff(cells[order], prepend=np.uint64(np.iinfo(np.uint64).max)))
    if not len(first):
        return _none()
    return SeenCells(
        cells[order][first], np.maximum.reduceat(level[order], first), np.add.reduceat(pixels[order], first)
    )
