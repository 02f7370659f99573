# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera tracks of an evaluation: half of the frames approach the model from far, half explore its details.

The paper uses 2,000 frames of 130 x 130 pixels for each scene (methods 4.1b, 7.26). A track depends on the octree and
the seed only. It consists of shots of about 200 frames: within a shot, cameras have one name and consecutive pictures
are similar; shots are separated by cuts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import SceneError, SettingError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import first_hits
from .explorations import Explorations
from .poses import Pose, Surroundings, none_seen

FAR = 3.0  # cube sides from the target
_MIN_SHARE = 0.95  # of a frame's hits with look-ahead, at its end
_ELEVATIONS = np.radians([5.0, 40.0])
_SWING = 0.25  # radians around the target per factor e of the distance
_TRIES = 24
_SCAN, _COARSE_SCAN = 60, 15  # distances tested from far to near, of the chosen line and of all lines
_MIN_TURN = 0.25  # radians between the azimuths of approaches, less for many of them
_SHOT = 200  # frames, about


@dataclass(frozen=True, eq=False)
class _Line:
    """Way to a target (3,) from an azimuth and an elevation (radians): a spiral around the vertical."""

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
    """Approaches to an octree, each from another side and to unseen surface."""

    def __init__(self, around: Surroundings, random: np.random.Generator) -> None:
        self._around = around
        self._random = random
        self._far_world = FAR * around.side_world
        self._seen = none_seen()
        self._azimuths: list[float] = []

    def shot(self, number: int, total: int, frames: int) -> list[Camera]:
        """Frames of approach `number` of `total`, counted from 1; the distance shrinks by a constant factor.

        Of several lines, the one whose end shows most unseen surface. Raises SceneError if nothing is visible from far.
        """
        name = f"Approach {number}"
        lines = [line for line in (self._line(total) for _ in range(_TRIES)) if line is not None]
        if not lines:
            raise SceneError("The octree is invisible from far away: give one of a scene with more surface")
        ends = [self._end(line) for line in lines]
        best = max(range(len(lines)), key=lambda index: ends[index].gain(self._seen))
        self._seen[ends[best].cells] += 1
        self._azimuths.append(lines[best].azimuth)
        distances = np.geomspace(self._far_world, self._nearest(lines[best], name), frames)
        return [self._camera(lines[best], distance, name) for distance in distances]

    def _camera(self, line: _Line, distance_world: float, name: str) -> Camera:
        return self._around.camera(line.position(distance_world, self._far_world), line.target_world, name)

    def _line(self, total: int) -> _Line | None:
        """Line from a random direction to a point of the surface visible from far; None if nothing is visible."""
        azimuth = self._azimuth(total)
        elevation = self._random.uniform(*_ELEVATIONS)
        swing = _SWING * self._random.choice([-1.0, 1.0])
        centre = self._around.space.bounds_world.mean(axis=0)
        camera = self._camera(_Line(centre, azimuth, elevation, swing), self._far_world, "")
        hits = first_hits(self._around.octree, camera)
        seen = np.flatnonzero(hits.hit)
        if not len(seen):
            return None
        pixel = int(self._random.choice(seen))
        target = camera.position_world + hits.direction[pixel].astype(np.float64) * hits.t_world[pixel]
        return _Line(target, azimuth, elevation, swing)

    def _azimuth(self, total: int) -> float:
        """Random azimuth far from those of earlier approaches, as far as their number allows."""
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
            if pose.share < _MIN_SHARE or not self._around.space.contains_path(way):
                break
            end = pose
        return end

    def _pose(self, line: _Line, distance_world: float) -> Pose:
        position = line.position(distance_world, self._far_world)
        return self._around.look(position, line.target_world - position)

    def _nearest(self, line: _Line, name: str) -> float:
        """Shortest distance with a free way and look-ahead on all of it."""
        reached = self._far_world
        for distance in self._distances(_SCAN):
            way = np.stack([line.position(each, self._far_world) for each in (reached, distance)])
            if not self._around.space.contains_path(way):
                break
            if self._around.share([self._camera(line, distance, name)]) < _MIN_SHARE:
                break
            reached = float(distance)
        return reached

    def _distances(self, count: int) -> np.ndarray:
        """Distances (count,) in world units from far to the nearest that has look-ahead at the picture's centre."""
        nearest = min(self._around.near_world, self._far_world)
        return np.geomspace(self._far_world, nearest, count + 1)[1:]


@dataclass(frozen=True)
class TrackSettings:
    """Settings of a track.

    frames: of the whole track. every: distance of the frames in use. size_px: of the pictures. seed: of the choice of
    targets and poses.
    """

    frames: int = 2000
    every: int = 10
    size_px: tuple[int, int] = (130, 130)
    seed: int = 0


def camera_track(octree: Octree, settings: TrackSettings, lookahead: int = DEFAULT_LOOKAHEAD) -> Steps[list[Camera]]:
    """Create a track of all its frames' cameras: approaches in the first half, explorations in the second.

    Cameras and the ways between them are at least four finest voxels from occupied voxels. At least 95 % of hits have
    look-ahead if the scene has room for that. An approach starts three cube sides away and comes nearer by a constant
    factor per frame, 1.3 % in 200 frames; an exploration moves at most 0.01 cube sides and turns at most 3 degrees per
    frame.

    octree: with leaves on one level. Raises SettingError for fewer than two frames or less depth than `lookahead`,
    SceneError without free space or visible surface.
    """
    frames = settings.frames
    if frames < 2:
        raise SettingError(f"A camera track of {frames} frames is too short: give at least 2 frames")
    if octree.depth <= lookahead:
        raise SettingError(f"Depth {octree.depth} has no {lookahead} levels of look-ahead: give a deeper octree")
    yield Progress(0, frames, "Looking for poses")
    around = Surroundings(octree, settings.size_px, lookahead)
    near_random, far_random = np.random.default_rng(settings.seed).spawn(2)
    approaches, explorations = Approaches(around, far_random), Explorations(around, near_random)
    cameras: list[Camera] = []
    first, second = _shots(frames - frames // 2), _shots(frames // 2)
    for number, length in enumerate(first, 1):
        cameras += approaches.shot(number, len(first), length)
        yield Progress(len(cameras), frames, "Laying approaches")
    for number, length in enumerate(second, 1):
        cameras += explorations.shot(number, length)
        yield Progress(len(cameras), frames, "Laying explorations")
    return cameras


def _shots(frames: int) -> list[int]:
    """Number of frames of each shot, as even as possible."""
    count = max(1, round(frames / _SHOT))
    return [frames * (number + 1) // count - frames * number // count for number in range(count)]
