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
from .poses import Lens

FAR = 3.0  # cube sides from the target
_MIN_SHARE = 0.95  # of a frame's hits with look-ahead, at its end
_ELEVATIONS = np.radians([5.0, 40.0])
_SWING = 0.25  # radians around the target for each factor of e that the camera comes nearer
_TRIES = 12
_SCAN = 60  # distances that are tried from far to near


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
    """Approaches to an octree, each from another side: azimuths lie evenly around it."""

    def __init__(
        self, octree: Octree, space: FreeSpace, lens: Lens, look_ahead: LookAhead, random: np.random.Generator
    ) -> None:
        self._octree = octree
        self._space = space
        self._lens = lens
        self._look_ahead = look_ahead
        self._random = random
        self._far_world = FAR * octree.grid.side_world

    def shot(self, number: int, total: int, frames: int) -> list[Camera]:
        """Frames of approach `number` of `total`, counted from 1; the distance shrinks by the same factor at each.

        Of several targets, the one that the camera comes nearest to. Raises SceneError if none is seen from far.
        """
        name = f"Approach {number}"
        best: tuple[float, _Line] | None = None
        for _ in range(_TRIES):
            line = self._line(number, total)
            if line is None:
                continue
            nearest = self._nearest(line, name)
            if best is None or nearest < best[0]:
                best = nearest, line
        if best is None:
            raise SceneError("Nothing of the octree is seen from far away: make it of a scene with more surface")
        nearest, line = best
        distances = np.geomspace(self._far_world, nearest, frames)
        return [self._camera(line, distance, name) for distance in distances]

    def _camera(self, line: _Line, distance_world: float, name: str) -> Camera:
        return self._lens.camera(line.position(distance_world, self._far_world), line.target_world, name)

    def _line(self, number: int, total: int) -> _Line | None:
        """Line from a random elevation to a point of the surface that is seen from far; None if nothing is seen."""
        azimuth = 2 * np.pi * (number - 1 + 0.6 * self._random.random()) / total
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

    def _nearest(self, line: _Line, name: str) -> float:
        """Shortest distance to which all the way is free and has look-ahead."""
        reached = self._far_world
        previous = line.position(reached, self._far_world)
        for distance in np.geomspace(self._far_world, self._lens.near_world, _SCAN)[1:]:
            position = line.position(distance, self._far_world)
            if not self._space.contains_path(np.stack([previous, position])):
                break
            if self._look_ahead.share([self._camera(line, distance, name)]) < _MIN_SHARE:
                break
            reached, previous = float(distance), position
        return reached
