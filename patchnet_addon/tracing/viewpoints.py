# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras in the free space of a lit octree that see much of it, for scenes without cameras.

Framing from outside shows only the outer walls of an interior. So cells with free space around them are tried in
several headings; each next camera shows the most surface, at middle distances, not shown by the previous ones. The
choice is deterministic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..octree.octree import Octree
from ..runtime.errors import SceneError, SettingError
from ..runtime.progress import Progress, Steps
from .camera import Camera
from .render import Hits, first_hits

FOV = float(np.radians(60.0))  # vertical
MAX_VIEWPOINTS = 64
_LEVEL = 6  # of cells for cameras, and of cells counted as seen
_MAX_POSITIONS = 192
_HEADINGS = 8
_PITCH = float(np.radians(-6.0))  # a little down, as at eye height
_TRIAL_PX = (32, 24)
_NEAR = 0.06  # of the surface's extent: nearer than that, voxels are larger than pixels
_MIDDLE = 0.15
_BRIGHT = 0.1  # exposed luminance of a view that is bright enough
_CLOSE_PX = (768, 576)  # voxels as fine as in a large picture
_MIN_BRIGHTNESS = 0.5  # of the small picture
_MIN_QUALITY = 0.25  # of the best view's
_SEES_OUT = 0.02  # of the places; smaller shares may see through cracks
_ROUND = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_ROUND_POSITIONS, _ROUND_PX = 64, (8, 8)
_ENCLOSED = 0.8  # of all directions in which a front face is hit: a room with windows
_INSIDE = 0.5  # of the free places: a room has 0.9, a hall without a roof 0.7, objects, courtyards, gardens below 0.1


@dataclass(frozen=True, eq=False)
class _Trial:
    """Tried camera: quality and brightness of its view, and the distinct cells (n,) int64 that it shows."""

    camera: Camera
    quality: float
    brightness: float
    cells: np.ndarray


def encloses(octree: Octree) -> bool:
    """Return whether the surface is an interior: most free places in its bounds see front faces all around.

    A closed object, such as a ball, shows only backs to the free space in it.
    """
    facing, _ = _surroundings(octree, free_positions(octree, _ROUND_POSITIONS))
    return bool(np.mean(facing > _ENCLOSED) > _INSIDE)


def _surroundings(octree: Octree, positions_world: np.ndarray) -> np.ndarray:
    """Shares (2, n) of all directions from positions (n, 3) in which a front face is hit, and in which nothing is."""
    shares = np.zeros((2, len(positions_world), len(_ROUND)))
    for row, position in enumerate(positions_world):
        for column, side in enumerate(_ROUND):
            hits = first_hits(octree, Camera.look_at(position, position + side, fov=np.pi / 2, size_px=_ROUND_PX))
            shares[:, row, column] = np.count_nonzero(_facing(octree, hits)) / len(hits.hit), 1.0 - hits.hit.mean()
    return shares.mean(axis=2)


def _in_rooms(octree: Octree, positions_world: np.ndarray) -> np.ndarray:
    """(n,) bool: places inside that see out through a window or a hole in a roof, which excludes hollows in walls.

    All places inside if hardly any sees out; all places if none is inside.
    """
    facing, empty = _surroundings(octree, positions_world)
    inside = facing > _ENCLOSED
    sees_out = inside & (empty > 0.0)
    return sees_out if np.count_nonzero(sees_out) > _SEES_OUT * len(inside) else inside | (not inside.any())


def viewpoints(octree: Octree, count: int, size_px: tuple[int, int], *, lit: bool = True) -> Steps[list[Camera]]:
    """Choose `count` upright perspective cameras View 1, View 2, ... in free space, at least one cell from voxels.

    lit: dark views count less; False for an octree without light, where cameras stand in rooms, see `_in_rooms`. Fewer
    if no further camera shows new cells. Raises SettingError for a count outside 1 to 64, SceneError if no place is
    free or sees the surface.
    """
    if not 1 <= count <= MAX_VIEWPOINTS:
        raise SettingError(f"{count} cameras are outside 1 to {MAX_VIEWPOINTS}: choose a number in this range")
    positions = free_positions(octree)
    if not lit:
        positions = positions[_in_rooms(octree, positions)]
    trials: list[_Trial] = []
    extent = float(np.ptp(_bounds(octree), axis=0).max())
    for number, position in enumerate(positions):
        yield Progress(number, len(positions), "Placing cameras")
        trials += [_tried(octree, camera, extent, lit=lit) for camera in _around(position)]
    chosen = _chosen(octree, [trial for trial in trials if trial.quality > 0.0 and len(trial.cells)], count, lit=lit)
    if not chosen:
        raise SceneError("No place in the scene has room and a view: add cameras, or use the cameras 'auto'")
    return [_named(trial.camera, index, size_px) for index, trial in enumerate(chosen, 1)]


def free_positions(octree: Octree, most: int = _MAX_POSITIONS) -> np.ndarray:
    """Centres (n, 3) float64, world units, of at most `most` evenly spread cells that touch no occupied cell."""
    level = min(_LEVEL, octree.depth)
    while True:
        occupied = occupied_cells(octree, level)
        free = _inside(occupied) & ~grown(occupied)
        if free.any() or level >= min(octree.depth, 8):
            break
        level += 1  # narrow spaces
    cells = np.argwhere(free)
    chosen = (
        cells[np.unique(np.linspace(0, len(cells) - 1, min(most, len(cells))).astype(int))] if len(cells) else cells
    )
    side = octree.grid.side_world / (1 << level)
    return np.asarray(octree.grid.origin_world) + (chosen + 0.5) * side


def occupied_cells(octree: Octree, level: int) -> np.ndarray:
    """(n, n, n) bool by x, y, z, including cells of coarser leaves."""
    side = 1 << level
    occupied = np.zeros((side, side, side), bool)
    occupied[tuple(octree.cells(level).T)] = True
    for above in range(level):
        cells = octree.cells(above)[octree.child_mask[octree.level(above)] == 0]
        size = 1 << (level - above)
        for x, y, z in cells * size:
            occupied[x : x + size, y : y + size, z : z + size] = True
    return occupied


def _inside(occupied: np.ndarray) -> np.ndarray:
    """(n, n, n) bool: cells in the bounding box of the occupied ones."""
    where = np.argwhere(occupied)
    low, high = where.min(axis=0), where.max(axis=0) + 1
    inside = np.zeros_like(occupied)
    inside[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = True
    return inside


def grown(occupied: np.ndarray) -> np.ndarray:
    """(n, n, n) bool: occupied, or with an occupied cell among the 26 around."""
    for axis in range(3):
        padded = np.pad(occupied, [(1, 1) if each == axis else (0, 0) for each in range(3)])
        size = occupied.shape[axis]
        first, middle, last = (np.take(padded, range(shift, shift + size), axis) for shift in range(3))
        occupied = first | middle | last
    return occupied


def _bounds(octree: Octree) -> np.ndarray:
    """Box (2, 3) of the surface in world units, to the accuracy of a cell."""
    level = min(_LEVEL, octree.depth)
    where = np.argwhere(occupied_cells(octree, level))
    side = octree.grid.side_world / (1 << level)
    corners = np.stack([where.min(axis=0), where.max(axis=0) + 1])
    return np.asarray(octree.grid.origin_world) + corners * side


def _around(position_world: np.ndarray) -> list[Camera]:
    """Small cameras at a position (3,), one for each heading."""
    angles = 2 * np.pi * np.arange(_HEADINGS) / _HEADINGS
    flat, drop = np.cos(_PITCH), np.sin(_PITCH)
    return [
        Camera.look_at(
            position_world,
            position_world + np.array([flat * np.cos(angle), flat * np.sin(angle), drop]),
            fov=FOV,
            size_px=_TRIAL_PX,
        )
        for angle in angles
    ]


def _facing(octree: Octree, hits: Hits) -> np.ndarray:
    """(n,) bool: whether a ray that hits does not hit a back face."""
    hit = hits.hit
    facing: np.ndarray = np.einsum("pc,pc->p", octree.normal_float(hits.node[hit]), hits.direction[hit]) < 0.2
    return facing


def _tried(octree: Octree, camera: Camera, extent: float, *, lit: bool) -> _Trial:
    hits = first_hits(octree, camera)
    hit = hits.hit
    if not hit.any():
        return _Trial(camera, 0.0, 0.0, np.empty(0, np.int64))
    distance = hits.t_world[hit] / extent
    brightness = float(np.mean(np.clip(hits.luminance[hit] / _BRIGHT, 0.0, 1.0))) if lit else 1.0
    quality = (
        float(hit.mean()) ** 2
        * float(np.mean(distance > _NEAR)) ** 4
        * float(np.clip(np.median(distance) / _MIDDLE, 0.0, 1.0))
        * float(_facing(octree, hits).mean()) ** 2
        * brightness**2
    )
    return _Trial(camera, quality, brightness, _cells_seen(hits))


def _cells_seen(hits: Hits) -> np.ndarray:
    """Distinct numbers of the cells of level 6 hit by rays; coarser voxels count as their first cell."""
    hit = hits.hit
    shift = hits.level[hit].astype(np.int64)[:, None] - _LEVEL
    cells = hits.cell[hit].astype(np.int64)
    cells = np.where(shift >= 0, cells >> np.maximum(shift, 0), cells << np.maximum(-shift, 0))
    return np.unique((cells[:, 0] << 2 * _LEVEL) | (cells[:, 1] << _LEVEL) | cells[:, 2])


def _chosen(octree: Octree, trials: list[_Trial], count: int, *, lit: bool) -> list[_Trial]:
    """Greedily choose the trials with the most new cells, weighted by quality, without those far below the best.

    Trials whose finest voxels are dark are excluded: in a hollow wall, coarse voxels hold light of the outside.
    """
    best_quality = max((trial.quality for trial in trials), default=0.0)
    trials = [trial for trial in trials if trial.quality >= _MIN_QUALITY * best_quality]
    seen = np.zeros(1 << 3 * _LEVEL, bool)
    chosen: list[_Trial] = []
    dark: list[_Trial] = []
    while trials and len(chosen) < count:
        gains = [trial.quality * np.count_nonzero(~seen[trial.cells]) for trial in trials]
        best = int(np.argmax(gains))
        if not gains[best] > 0:
            break
        trial = trials.pop(best)
        if lit and _brightness(octree, _named(trial.camera, 0, _CLOSE_PX)) < _MIN_BRIGHTNESS * trial.brightness:
            dark.append(trial)
            continue
        chosen.append(trial)
        seen[trial.cells] = True
    return chosen or dark[:count]


def _brightness(octree: Octree, camera: Camera) -> float:
    """Mean luminance of a camera's view, 1 from _BRIGHT on; 0 if it sees nothing."""
    hits = first_hits(octree, camera)
    hit = hits.hit
    return float(np.mean(np.clip(hits.luminance[hit] / _BRIGHT, 0.0, 1.0))) if hit.any() else 0.0


def _named(camera: Camera, number: int, size_px: tuple[int, int]) -> Camera:
    target = camera.position_world + camera.forward
    return Camera.look_at(camera.position_world, target, fov=FOV, size_px=size_px, name=f"View {number}")
