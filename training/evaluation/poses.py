# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera poses with look-ahead, and the free space for cameras (methods 4.1b, 7.26)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import first_hits
from ...patchnet_addon.tracing.viewpoints import grown, occupied_cells

_LEVELS_ABOVE_LEAVES = 2  # a cell is four finest voxels wide
_MAX_LEVEL = 8  # 17 million cells
FOV = float(np.radians(60.0))  # vertical
MIN_SHARE = 0.97  # of a pose's hits with look-ahead: more than the track needs, since ways between poses may have less
_POSITIONS = 200  # tries in the surface's box, and as many around it
_AROUND, _AROUND_NEAR = 0.5, 1.5  # around that box: cube sides, or nearest distances, if larger
_HEADINGS = 6
_PITCHES = np.radians([-30.0, -8.0, 12.0])
_AIMS = 9  # directions from each position around the box, to points in it
_TRIAL_PX = 20  # height
_CELLS = 32  # cells along a side of the cube, to record seen surface
_BRIGHT = 0.1  # least luminance of lit surface
_BEND = 0.05  # of 1 / z from pixel to pixel, above steps between voxels
_ENCLOSED = 0.7  # share of hits in all directions, above which a position counts as enclosed
_ENOUGH = 24  # enclosed poses, from which on only these are used


class FreeSpace:
    """Cells of a level that are neither occupied nor adjacent to occupied cells, and everything outside the cube.

    A free point is at least `clearance_world` from every occupied voxel: four finest voxels, more below depth 10.
    bounds_world: (2, 3) float64, box of the occupied cells.
    """

    def __init__(self, octree: Octree) -> None:
        self._grid = octree.grid
        self._level = min(max(octree.depth - _LEVELS_ABOVE_LEAVES, 0), _MAX_LEVEL)
        occupied = np.pad(occupied_cells(octree, self._level), 1)
        self._blocked = grown(occupied)
        self.clearance_world: float = octree.grid.side_world / (1 << self._level)
        where = np.argwhere(occupied) - 1
        corners = np.stack([where.min(axis=0), where.max(axis=0) + 1])
        self.bounds_world: np.ndarray = octree.grid.to_world(corners / (1 << self._level))

    def contains(self, points_world: np.ndarray) -> np.ndarray:
        """Test which points (N, 3) are free: (N,) bool."""
        cells = np.floor(self._grid.to_unit(points_world) * (1 << self._level)).astype(np.int64) + 1
        inside = ((cells >= 0) & (cells < len(self._blocked))).all(axis=1)
        x, y, z = np.where(inside[:, None], cells, 0).T
        return ~(inside & self._blocked[x, y, z])

    def contains_path(self, points_world: np.ndarray) -> bool:
        """Test whether the whole polyline through points (N, 3) is free."""
        spacing = 0.5 * self.clearance_world
        for start, end in pairwise(points_world):
            count = int(np.linalg.norm(end - start) / spacing) + 2
            if not self.contains(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)).all():
                return False
        return bool(self.contains(points_world[-1:]).all())


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and look-at target (3,), world units, and statistics of a small picture from there.

    share: of hits that are far enough for look-ahead. hit: share of hits. quality: of the view, 0 to 1: high for a
    picture full of lit, near surface that is not flat. cells: (n,) int64, distinct indices of the visible cells.
    """

    position_world: np.ndarray
    target_world: np.ndarray
    share: float
    hit: float
    quality: float
    cells: np.ndarray

    def gain(self, seen: np.ndarray) -> float:
        """Value of its cells, each 1 / (1 + times it was shown, see `none_seen`), times its quality."""
        return self.quality * float(np.sum(1.0 / (1.0 + seen[self.cells])))

    @property
    def forward(self) -> np.ndarray:
        """Unit viewing direction (3,)."""
        along = self.target_world - self.position_world
        return along / np.linalg.norm(along)


def none_seen() -> np.ndarray:
    """Number of times (n,) that each cell of the cube was shown, to prefer views of other surface."""
    return np.zeros(_CELLS**3, np.int64)


class Surroundings:
    """Octree for cameras of one picture size, and the free space around and in it.

    near_world: axial distance in world units from which hits have look-ahead: from there on rays stop at or above level
    depth - lookahead, 2 c z = side of such a voxel (methods 4.1b, 7.26).
    """

    def __init__(self, octree: Octree, size_px: tuple[int, int], lookahead: int) -> None:
        self.octree, self.space = octree, FreeSpace(octree)
        self.side_world = octree.grid.side_world
        pixel = 2.0 * np.tan(FOV / 2) / size_px[1]
        self.near_world = float(self.side_world * 2.0 ** (lookahead - octree.depth) / (2.0 * pixel))
        self._size_px = size_px
        self._ahead = octree.look_ahead(lookahead)

    def camera(self, position_world: np.ndarray, target_world: np.ndarray, name: str) -> Camera:
        """Upright camera of a track."""
        return Camera.look_at(position_world, target_world, fov=FOV, size_px=self._size_px, name=name)

    def share(self, cameras: Sequence[Camera]) -> float:
        """Share of the hits of all cameras that have look-ahead; 1 without hits."""
        seen = [first_hits(self.octree, camera) for camera in cameras]
        ahead = np.concatenate([self._ahead[hits.node[hits.hit]] for hits in seen])
        return float(ahead.mean()) if len(ahead) else 1.0

    def look(self, position_world: np.ndarray, forward: np.ndarray) -> Pose:
        """Pose at a position (3,) in a direction (3,); its target is at the median distance of the hits."""
        width, height = self._size_px
        size_px = (max(1, round(_TRIAL_PX * width / height)), _TRIAL_PX)
        camera = Camera.look_at(position_world, position_world + forward, fov=FOV, size_px=size_px)
        hits = first_hits(self.octree, camera)
        seen = hits.hit
        if not seen.any():
            target = position_world + forward * self.near_world
            return Pose(position_world, target, 1.0, 0.0, 0.0, np.empty(0, np.int64))
        z_world = hits.z_world[seen].astype(np.float64)
        middle = float(np.median(z_world))
        hit = float(seen.mean())
        lit = float(np.clip(hits.luminance[seen] / _BRIGHT, 0.0, 1.0).mean())
        points = position_world + hits.direction[seen] * hits.t_world[seen, None]
        relief = _relief(hits.z_world.reshape(hits.height_px, hits.width_px))
        cells = np.clip(self.octree.grid.to_unit(points) * _CELLS, 0, _CELLS - 1).astype(np.int64)
        return Pose(
            position_world,
            position_world + camera.forward * middle,
            share=float((z_world > self.near_world).mean()),
            hit=hit,
            quality=hit * lit * relief * min(self.near_world / middle, 1.0),
            cells=np.unique((cells[:, 0] * _CELLS + cells[:, 1]) * _CELLS + cells[:, 2]),
        )

    def find_poses(self, random: np.random.Generator) -> list[Pose]:
        """Poses with look-ahead at random positions; only enclosed ones if there are enough of them."""
        low, high = self.space.bounds_world
        margin = max(_AROUND * self.side_world, _AROUND_NEAR * self.near_world)
        inside: list[Pose] = []
        outside: list[Pose] = []
        for position in self._free(random.uniform(low, high, (_POSITIONS, 3))):
            around = [self.look(position, forward) for forward in _all_around(random)]
            enclosed = np.mean([pose.hit for pose in around]) >= _ENCLOSED
            (inside if enclosed else outside).extend(around)
        for position in self._free(random.uniform(low - [margin, margin, 0.0], high + margin, (_POSITIONS, 3))):
            towards = random.uniform(low, high, (_AIMS, 3)) - position
            outside.extend(self.look(position, forward) for forward in towards)
        inside, outside = (
            [pose for pose in poses if pose.share >= MIN_SHARE and pose.hit] for poses in (inside, outside)
        )
        return inside if len(inside) >= _ENOUGH else inside + outside

    def _free(self, points_world: np.ndarray) -> np.ndarray:
        return points_world[self.space.contains(points_world)]


def _relief(z_world: np.ndarray) -> float:
    """Share of a depth picture's pixels (H, W) at edges or bends of surface: 1 / z is linear over a plane."""
    inverse = 1.0 / z_world.astype(np.float64)  # 0 where nothing is hit
    bend = np.abs(inverse[:, :-2] - 2.0 * inverse[:, 1:-1] + inverse[:, 2:])
    return float(np.mean(bend > _BEND * inverse[:, 1:-1])) if bend.size else 0.0


def _all_around(random: np.random.Generator) -> list[np.ndarray]:
    """Unit vectors (3,) of all headings and several pitches."""
    angles = 2 * np.pi * (np.arange(_HEADINGS) + random.random()) / _HEADINGS
    return [
        np.array([np.cos(pitch) * np.cos(angle), np.cos(pitch) * np.sin(angle), np.sin(pitch)])
        for pitch in _PITCHES
        for angle in angles
    ]


def step_of(one: Camera, other: Camera) -> float:
    """Distance between two cameras in world units."""
    return float(np.linalg.norm(other.position_world - one.position_world))


def turn_of(one: Camera, other: Camera) -> float:
    """Angle of the rotation between two cameras in radians, roll included."""
    axes, other_axes = (np.stack([camera.right, camera.up, camera.forward]) for camera in (one, other))
    return float(np.arccos(np.clip((np.sum(axes * other_axes) - 1.0) / 2.0, -1.0, 1.0)))
