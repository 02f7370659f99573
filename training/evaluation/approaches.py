# SPDX-License-Identifier: GPL-3.0-or-later
"""Approaches to the model: a camera that comes from far, as near as there is look-ahead and room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import first_hits
from .free_space import FreeSpace
from .look_ahead import LookAhead
from .poses import Lens, Pose, Seen, look

FAR = 3.0  # cube sides from the target
_MIN_SHARE = 0.95  # of a frame's hits with look-ahead, at its end
_ELEVATIONS = np.radians([5.0, 40.0])
_SWING = 0.25  # radians around the target for each factor of e that the camera comes nearer
_TRIES = 24
_SCAN, _COARSE_SCAN = 60, 15  # distances that are tried from far to near, of the line that is taken and of all
_MIN_TURN = 0.25  # radians between the azimuths of approaches, less where they are many


@dataclass(frozen=True, eq=False)
class _Line:
    """Way to a target (3,) from an azimuth and an elevation (radians), a spiral around the vertical."""

    target_world: np.ndarray
    azimuth: float
    elevation: float
    swing: float

    def position(self, distance_world: float, far_world: float) -> np.ndarray:
        """Point (3,) of the way at a distance from the target."""
        angle = self.azimuth + self.swing * np.log(far_world / distance_world)
        flat = np.cos(self.elevation)
        away = np.array([flat * np.cos(angle), flat * np.sin(angle), np.sin(self.elevation)])
        return self.target_world + distance_world * away


class Approaches:
    """Approaches to an octree, each from another side and to what none before has shown."""

    def __init__(
        self, octree: Octree, space: FreeSpace, lens: Lens, look_ahead: LookAhead, random: np.random.Generator
    ) -> None:
        self._octree = octree
        self._space = space
        self._lens = lens
        self._look_ahead = look_ahead
        self._random = random
        self._far_world = FAR * octree.grid.side_world
        self._seen = Seen()
        self._azimuths: list[float] = []

    def shot(self, number: int, total: int, frames: int) -> list[Camera]:
        """Frames of approach `number` of `total`, counted from 1; the distance shrinks by the same factor at each.

        Of several lines, the one whose end shows most that is new. Raises SceneError if nothing is seen from far.
        """
        name = f"Approach {number}"
        lines = [line for line in (self._line(total) for _ in range(_TRIES)) if line is not None]
        if not lines:
            raise SceneError("Nothing of the octree is seen from far away: make it of a scene with more surface")
        ends = [self._end(line) for line in lines]
        best = max(range(len(lines)), key=lambda index: self._seen.gain(ends[index]))
        self._seen.add(ends[best])
        self._azimuths.append(lines[best].azimuth)
        distances = np.geomspace(self._far_world, self._nearest(lines[best], name), frames)
        return [self._camera(lines[best], distance, name) for distance in distances]

    def _camera(self, line: _Line, distance_world: float, name: str) -> Camera:
        return self._lens.camera(line.position(distance_world, self._far_world), line.target_world, name)

    def _line(self, total: int) -> _Line | None:
        """Line from a random direction to a point of the surface that is seen from far; None if nothing is seen."""
        azimuth = self._azimuth(total)
        elevation = self._random.uniform(*_ELEVATIONS)
        swing = _SWING * self._random.choice([-1.0, 1.0])
        centre = self._space.bounds_world.mean(axis=0)
        camera = self._camera(_Line(centre, azimuth, elevation, swing), self._far_world, "")
        hits = first_hits(self._octree, camera)
        seen = np.flatnonzero(hits.hit)
        if not len(seen):
            return None
        pixel = int(self._random.choice(seen))
        target = camera.position_world + hits.direction[pixel].astype(np.float64) * hits.t_world[pixel]
        return _Line(target, azimuth, elevation, swing)

    def _azimuth(self, total: int) -> float:
        """Random azimuth that is not near one of the approaches before, as far as that many leave room."""
        apart = min(_MIN_TURN, np.pi / (2 * total))
        while True:
            azimuth = float(self._random.uniform(0.0, 2 * np.pi))
            turns = [abs((azimuth - other + np.pi) % (2 * np.pi) - np.pi) for other in self._azimuths]
            if min(turns, default=np.pi) >= apart:
                return azimuth

    def _end(self, line: _Line) -> Pose:
        """Pose at about the end of a line, found with small pictures."""
        end = self._pose(line, self._far_world)
        for distance in self._distances(_COARSE_SCAN):
            pose = self._pose(line, distance)
            way = np.stack([end.position_world, pose.position_world])
            if pose.share < _MIN_SHARE or not self._space.contains_path(way):
                break
            end = pose
        return end

    def _pose(self, line: _Line, distance_world: float) -> Pose:
        position = line.position(distance_world, self._far_world)
        return look(self._octree, self._lens, position, line.target_world - position)

    def _nearest(self, line: _Line, name: str) -> float:
        """Shortest distance to which all the way is free and has look-ahead."""
        reached = self._far_world
        for distance in self._distances(_SCAN):
            way = np.stack([line.position(each, self._far_world) for each in (reached, distance)])
            if not self._space.contains_path(way):
                break
            if self._look_ahead.share([self._camera(line, distance, name)]) < _MIN_SHARE:
                break
            reached = float(distance)
        return reached

    def _distances(self, count: int) -> np.ndarray:
        """Distances (count,) in world units from far to the nearest that has look-ahead at the picture's centre."""
        nearest = min(self._lens.near_world, self._far_world)
        return np.geomspace(self._far_world, nearest, count + 1)[1:]
