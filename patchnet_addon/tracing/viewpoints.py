# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras that show what is in an octree, for scenes without cameras.

Cameras in free space, and around a scene that is no interior, are tried. A view counts by the surface that it shows and
other chosen views do not, half of it by area, half by detail: furniture counts more than the walls of its room. The
choice is deterministic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..octree.octree import Octree
from ..runtime.errors import SceneError, SettingError
from ..runtime.progress import Progress, Steps
from .camera import FRAMING_DIRECTION, Camera
from .detail import detailed_core, surface_detail
from .hits import Hits
from .render import first_hits

FOV = float(np.radians(60.0))  # vertical
MAX_VIEWPOINTS = 64
_LEVEL = 6  # of cells for cameras, and around which detail is measured
_SEEN_LEVEL = 4  # of cells counted as seen: two small pixels wide where the whole scene fills the picture
_MAX_POSITIONS, _CORE_POSITIONS = 192, 48
_HEADINGS = 8
_PITCH = float(np.radians(-12.0))  # a little down, on furniture more than on ceilings
_ELEVATIONS = np.radians([15.0, 30.0, 45.0])  # of cameras around the scene
_AIR, _CORE_AIR = 1.1, 1.6  # distance over the one at which the scene or its core fills the picture
_TRIAL_PX = 768
_SHARE_SEEN = 0.2  # of a scene that one picture can show well
_BRIGHT = 0.1  # exposed luminance of a view that is bright enough
_CLOSE_PX = (768, 576)  # voxels as fine as in a large picture
_MIN_BRIGHTNESS = 0.5  # of the small picture
_NEAR_BEST, _CHOICE = (0.35, 0.7), 4  # of the best view's worth; views to choose from for each camera, if possible
_FROM_BEHIND = 0.9  # of the worth: objects face -y
_GROUND, _UPWARD = 0.8, 0.5  # of the directions down from a place that has ground below; z of its normals
_FEW = 0.02  # of the places: fewer see out through cracks, or stand on a ledge
_ROUND = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_ROUND_POSITIONS, _ROUND_PX = 64, (8, 8)
_ENCLOSED = 0.8  # of all directions in which a front face is hit: a room with windows
_INSIDE = 0.5  # of the free places: a room has 0.9, a hall without a roof 0.7, objects, courtyards, gardens below 0.1


@dataclass(frozen=True, eq=False)
class _Trial:
    """Tried camera: quality and brightness of its view, distinct cells (n,) int64 shown, and pixels of each (n,)."""

    camera: Camera
    quality: float
    brightness: float
    cells: np.ndarray
    pixels: np.ndarray


def encloses(octree: Octree) -> bool:
    """Return whether the surface is an interior: most free places in its bounds see front faces all around.

    A closed object, such as a ball, shows only backs to the free space in it.
    """
    return _is_interior(_surroundings(octree, free_positions(octree, _ROUND_POSITIONS))[0])


def _is_interior(facing: np.ndarray) -> bool:
    return len(facing) > 0 and bool(np.mean(facing.mean(axis=1) > _ENCLOSED) > _INSIDE)


def _surroundings(octree: Octree, positions_world: np.ndarray) -> np.ndarray:
    """Shares (3, n, 6) of directions to each side of positions (n, 3): a front face, nothing, surface that faces up."""
    shares = np.zeros((3, len(positions_world), len(_ROUND)))
    for row, position in enumerate(positions_world):
        for column, side in enumerate(_ROUND):
            hits = first_hits(octree, Camera.look_at(position, position + side, fov=np.pi / 2, size_px=_ROUND_PX))
            upward = octree.normal_float(hits.node[hits.hit])[:, 2] > _UPWARD
            counts = np.count_nonzero(_facing(octree, hits)), np.count_nonzero(~hits.hit), np.count_nonzero(upward)
            shares[:, row, column] = np.array(counts) / len(hits.hit)
    return shares


def _candidates(octree: Octree, core: np.ndarray, size_px: tuple[int, int]) -> list[Camera]:
    """Cameras to try in an octree without light: in the rooms of an interior, else around the scene and above ground.

    core: cells (n, 3) of level _LEVEL.
    """
    positions = free_positions(octree, _MAX_POSITIONS - _CORE_POSITIONS)
    if len(core):
        reach = (np.ptp(core, axis=0) + 1.0) / 2
        box = np.stack([core.min(axis=0) - reach, core.max(axis=0) + 1 + reach]) / (1 << _level(octree))
        positions = np.concatenate([positions, free_positions(octree, _CORE_POSITIONS, octree.grid.to_world(box))])
    facing, empty, upward = _surroundings(octree, positions)
    if _is_interior(facing):
        return _within(positions[_in_rooms(facing, empty)], size_px)
    above = np.flatnonzero(upward[:, -1] > _GROUND)
    standing = positions[above] if len(above) > _FEW * len(positions) else positions[:0]
    return [*_around(octree, core, size_px), *_within(standing, size_px)]


def _in_rooms(facing: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """(n,) bool: places inside that see out through a window or a hole in a roof, which excludes hollows in walls.

    All places inside if hardly any sees out. facing, empty: as `_surroundings`.
    """
    inside = facing.mean(axis=1) > _ENCLOSED
    sees_out = inside & empty.any(axis=1)
    return sees_out if sees_out.mean() > _FEW else inside


def _level(octree: Octree) -> int:
    return min(_LEVEL, octree.depth)


def viewpoints(octree: Octree, count: int, size_px: tuple[int, int], *, lit: bool = True) -> Steps[list[Camera]]:
    """Choose `count` upright perspective cameras View 1, View 2, ...; fewer if no further one shows anything new.

    lit: in free space where light falls, at least one cell from voxels; False for an octree without light, where
    cameras may also look at the scene from outside, see `_candidates`. Raises SettingError for a count outside 1 to 64,
    SceneError if no lit place is free or sees the surface.
    """
    if not 1 <= count <= MAX_VIEWPOINTS:
        raise SettingError(f"{count} cameras are outside 1 to {MAX_VIEWPOINTS}: choose a number in this range")
    detail = surface_detail(octree, _level(octree))
    core, trial_px = detailed_core(detail), _trial_px(size_px)
    cameras = _within(free_positions(octree), trial_px) if lit else _candidates(octree, core, trial_px)
    trials: list[_Trial] = []
    for number, camera in enumerate(cameras):
        if not number % _HEADINGS:
            yield Progress(number, len(cameras), "Placing cameras")
        trials.append(_tried(octree, camera, lit=lit))
    chosen = _chosen(octree, trials, _worth(octree, detail), count, lit=lit)
    if not (chosen or lit):
        chosen = _around(octree, core, trial_px)[:1]
    if not chosen:
        raise SceneError("No place in the scene has room and a view: add cameras, or use the cameras 'auto'")
    return [_named(camera, index, size_px) for index, camera in enumerate(chosen, 1)]


def _trial_px(size_px: tuple[int, int]) -> tuple[int, int]:
    """Size of a picture of the same aspect with about _TRIAL_PX pixels."""
    width, height = np.maximum(np.round(np.array(size_px) * np.sqrt(_TRIAL_PX / np.prod(size_px))), 1).astype(int)
    return int(width), int(height)


def free_positions(octree: Octree, most: int = _MAX_POSITIONS, box_world: np.ndarray | None = None) -> np.ndarray:
    """Centres (n, 3) float64, world units, of at most `most` evenly spread cells that touch no occupied cell.

    box_world: (2, 3) around the centres; None for the bounds of the surface.
    """
    level = _level(octree)
    while True:
        occupied = occupied_cells(octree, level)
        free = _inside(occupied) & ~grown(occupied)
        if free.any() or level >= min(octree.depth, 8):
            break
        level += 1  # narrow spaces
    places = octree.grid.to_world((np.argwhere(free) + 0.5) / (1 << level))
    if box_world is not None:
        places = places[((places >= box_world[0]) & (places <= box_world[1])).all(axis=1)]
    return places[np.unique(np.linspace(0, len(places) - 1, min(most, len(places))).astype(int))]


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


def _within(positions_world: np.ndarray, size_px: tuple[int, int]) -> list[Camera]:
    """Cameras at positions (n, 3), one for each heading."""
    directions = _directions(np.array([-_PITCH]))
    return [
        Camera.look_at(position, position - direction, fov=FOV, size_px=size_px)
        for position in positions_world
        for direction in directions
    ]


def _around(octree: Octree, core: np.ndarray, size_px: tuple[int, int]) -> list[Camera]:
    """Cameras that look at the whole surface, and at cells (n, 3) of its core, from outside of each."""
    occupied = occupied_cells(octree, _level(octree))
    return [
        _framing(octree.grid.to_world((cells + 0.5) / len(occupied)), direction, size_px, air)
        for cells, air in ((np.argwhere(occupied), _AIR), (core, _CORE_AIR))
        if len(cells)
        for direction in [FRAMING_DIRECTION, *_directions(_ELEVATIONS)]
    ]


def _framing(points_world: np.ndarray, direction: np.ndarray, size_px: tuple[int, int], air: float) -> Camera:
    """Camera that looks from a direction (3,) at points (n, 3), which just fill its picture."""
    centre = (points_world.min(axis=0) + points_world.max(axis=0)) / 2
    camera = Camera.look_at(centre + direction, centre, fov=FOV, size_px=size_px)
    x, y, z = np.stack([camera.right, camera.up, camera.forward]) @ (points_world - centre).T
    distance = np.max(np.maximum(np.abs(x) / camera.half_x, np.abs(y) / camera.half_y) - z)
    return replace(camera, position_world=centre - air * distance * camera.forward)


def _directions(elevations: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3), for each heading at each elevation."""
    angle, up = (each.ravel() for each in np.meshgrid(2 * np.pi * np.arange(_HEADINGS) / _HEADINGS, elevations))
    return np.stack([np.cos(up) * np.cos(angle), np.cos(up) * np.sin(angle), np.sin(up)], axis=1)


def _facing(octree: Octree, hits: Hits) -> np.ndarray:
    """(n,) bool: whether a ray that hits does not hit a back face."""
    hit = hits.hit
    facing: np.ndarray = np.einsum("pc,pc->p", octree.normal_float(hits.node[hit]), hits.direction[hit]) < 0.2
    return facing


def _tried(octree: Octree, camera: Camera, *, lit: bool) -> _Trial:
    hits = first_hits(octree, camera)
    facing, brightness = _facing(octree, hits), _brightness(hits) if lit else 1.0
    front = np.flatnonzero(hits.hit)[facing]
    cells, pixels = np.unique(_cells_seen(hits, front, min(_SEEN_LEVEL, octree.depth)), return_counts=True)
    quality = (len(front) / max(len(facing), 1)) ** 2 * brightness**2
    if camera.forward[1] < 0.0:
        quality *= _FROM_BEHIND
    return _Trial(camera, quality, brightness, cells, pixels)


def _cells_seen(hits: Hits, pixels: np.ndarray, level: int) -> np.ndarray:
    """Numbers (n,) int64 of cells of a level hit by rays of pixels (n,); coarser voxels count as their first cell."""
    shift = hits.level[pixels].astype(np.int64)[:, None] - level
    cells = hits.cell[pixels].astype(np.int64)
    cells = np.where(shift >= 0, cells >> np.maximum(shift, 0), cells << np.maximum(-shift, 0))
    numbers: np.ndarray = (cells[:, 0] << 2 * level) | (cells[:, 1] << level) | cells[:, 2]
    return numbers


def _chosen(octree: Octree, trials: list[_Trial], value: np.ndarray, count: int, *, lit: bool) -> list[Camera]:
    """Greedily choose the trials that show most worth (cells,) not shown yet.

    A pixel shows a limited worth, so that a cell of much detail needs many of them. Trials whose finest voxels are dark
    are excluded: in a hollow wall, coarse voxels hold light of the outside.
    """
    per_pixel = float(value.sum()) / (_SHARE_SEEN * _TRIAL_PX)
    shown = np.zeros_like(value)
    trials = _best(trials, np.array([_gain(trial, value, shown, per_pixel) for trial in trials]), count)
    chosen: list[Camera] = []
    dark: list[Camera] = []
    while trials and len(chosen) < count:
        gains = [_gain(trial, value, shown, per_pixel) for trial in trials]
        best = int(np.argmax(gains))
        if not gains[best] > 0:
            break
        trial = trials.pop(best)
        if lit and _close_brightness(octree, trial.camera) < _MIN_BRIGHTNESS * trial.brightness:
            dark.append(trial.camera)
            continue
        chosen.append(trial.camera)
        shown[trial.cells] += per_pixel * trial.pixels
    return chosen or dark[:count]


def _best(trials: list[_Trial], worth: np.ndarray, count: int) -> list[_Trial]:
    """Trials whose worth (n,) is near the best one's, and some more where these are few."""
    enough = np.sort(worth)[-_CHOICE * count :].min(initial=np.inf)
    least, most = np.array(_NEAR_BEST) * worth.max(initial=0.0)
    return [trials[index] for index in np.flatnonzero(worth >= np.clip(enough, least, most))]


def _gain(trial: _Trial, value: np.ndarray, shown: np.ndarray, per_pixel: float) -> float:
    most, before = value[trial.cells], shown[trial.cells]
    new = np.minimum(most, before + per_pixel * trial.pixels) - np.minimum(most, before)
    return trial.quality * float(new.sum())


def _close_brightness(octree: Octree, camera: Camera) -> float:
    return _brightness(first_hits(octree, camera.with_size(*_CLOSE_PX)))


def _brightness(hits: Hits) -> float:
    """Mean luminance of a view, 1 from _BRIGHT on; 0 if it sees nothing."""
    hit = hits.hit
    return float(np.mean(np.clip(hits.luminance[hit] / _BRIGHT, 0.0, 1.0))) if hit.any() else 0.0


def _named(camera: Camera, number: int, size_px: tuple[int, int]) -> Camera:
    target = camera.position_world + camera.forward
    return Camera.look_at(camera.position_world, target, fov=FOV, size_px=size_px, name=f"View {number}")


def _worth(octree: Octree, detail: np.ndarray) -> np.ndarray:
    """Worth (n,) float64 of the cells counted as seen: shares of the surface and of its detail, half each."""
    level = min(_SEEN_LEVEL, octree.depth)
    blocks = (1 << level, len(detail) >> level) * 3
    area, details = (
        each.reshape(blocks).sum(axis=(1, 3, 5)).ravel() for each in (occupied_cells(octree, _level(octree)), detail)
    )
    worth: np.ndarray = area / area.sum() + details / max(float(details.sum()), 1e-9)
    return worth
