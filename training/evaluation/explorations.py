# SPDX-License-Identifier: GPL-3.0-or-later
"""Explorations of details: smooth flights through free space, from pose to pose, each to unseen surface."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.tracing.camera import Camera
from .poses import Pose, Surroundings, none_seen, step_of, turn_of

MAX_STEP = 0.01  # cube sides from frame to frame
MAX_TURN = float(np.radians(3.0))  # from frame to frame
_STEP, _TURN = 0.5 * MAX_STEP, 0.5 * MAX_TURN  # means between two poses: the spline is locally faster
_MIN_LEG, _MAX_LEG = 0.05, 0.45  # cube sides between two poses,
_MAX_LEG_NEAR = 0.75  # or nearest distances, if larger
_MAX_ANGLE = float(np.radians(75.0))  # between the directions of two poses
_MIN_SHARE = 0.96  # wanted share of a shot's hits with look-ahead
_ON_THE_WAY = (0.25, 0.5, 0.75)  # samples of a leg for its look-ahead
_TRIED_LEGS = 24
_TRIED_SHOTS = 24
_SPEEDS = (1.0, 0.5, 0.25)  # tries for a smooth flight: steep views turn fast
_EVERY = 8  # frames of a shot for its look-ahead


def catmull_rom(times: np.ndarray, points: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values (N, C) at times `wanted` (N,) of the spline through points (K, C) at ascending times (K,).

    Tangents are finite differences over uneven times; at both ends they are those of the straight segment. A single
    point is constant.
    """
    if len(points) == 1:
        return np.repeat(points, len(wanted), axis=0)
    return np.asarray(CubicHermiteSpline(times, points, np.gradient(points, times, axis=0))(wanted))


class Explorations:
    """Explorations of an octree; each remembers the cells that were shown."""

    def __init__(self, around: Surroundings, random: np.random.Generator) -> None:
        self._around = around
        self._side = around.side_world
        self._poses = around.find_poses(random)
        self._max_leg = max(_MAX_LEG, _MAX_LEG_NEAR * around.near_world / self._side)
        self._seen = none_seen()

    def shot(self, number: int, frames: int) -> list[Camera]:
        """Frames of exploration `number`, or the best one found if none is long enough or has the wanted look-ahead.

        Raises SceneError if there is no room for any.
        """
        starts = sorted(self._poses, key=lambda pose: pose.gain(self._seen), reverse=True)[:_TRIED_SHOTS]
        tried = (self._best(starts, frames, f"Exploration {number}", speed) for speed in _SPEEDS)
        best = next(filter(None, tried), None)
        if best is None:
            raise SceneError("No flight through the octree's free space was found: choose another seed or more depth")
        cameras, walk = best
        for pose in walk:
            self._seen[pose.cells] += 1
        return cameras

    def _best(self, starts: list[Pose], frames: int, name: str, speed: float) -> tuple[list[Camera], list[Pose]] | None:
        """Flight from one of the poses, and its walk; None if no flight is smooth.

        It is the first that is long enough and has the wanted look-ahead, otherwise the one with the most.
        """
        best: tuple[bool, float, list[Camera], list[Pose]] | None = None
        for start in starts:
            walk = self._walk(start, frames)
            lasts = self._times(walk)[-1] >= frames - 1
            if best is not None and best[0] > lasts:
                continue
            cameras = self._flight(walk, frames, name, speed)
            if not self._is_smooth(cameras):
                continue
            share = self._around.share(cameras[::_EVERY])
            if best is None or (lasts, share) > best[:2]:
                best = lasts, share, cameras, walk
            if lasts and share >= _MIN_SHARE:
                break
        return None if best is None else best[2:]

    def _walk(self, start: Pose, frames: int) -> list[Pose]:
        """Successive poses for at least `frames` frames, fewer without a continuation."""
        walk = [start]
        seen = self._seen.copy()
        seen[start.cells] += 1
        while self._times(walk)[-1] < frames:
            following = self._next(walk, seen)
            if following is None:
                break
            walk.append(following)
            seen[following.cells] += 1
        return walk

    def _next(self, walk: list[Pose], seen: np.ndarray) -> Pose | None:
        """Pose with most unseen cells among those with a straight and free way with look-ahead."""
        here = walk[-1]
        near = [pose for pose in self._poses if self._is_near(here, pose) and not any(pose is old for old in walk)]
        for pose in sorted(near, key=lambda pose: pose.gain(seen), reverse=True)[:_TRIED_LEGS]:
            if self._is_open(here, pose):
                return pose
        return None

    def _is_near(self, here: Pose, pose: Pose) -> bool:
        distance = float(np.linalg.norm(pose.position_world - here.position_world)) / self._side
        return _MIN_LEG <= distance <= self._max_leg and _angle(here, pose) <= _MAX_ANGLE

    def _is_open(self, here: Pose, pose: Pose) -> bool:
        """Return whether the straight way is free, with nearly the wanted look-ahead."""
        if not self._around.space.contains_path(np.stack([here.position_world, pose.position_world])):
            return False
        for share in _ON_THE_WAY:
            position = here.position_world + share * (pose.position_world - here.position_world)
            target = here.target_world + share * (pose.target_world - here.target_world)
            if self._around.look(position, target - position).share < _MIN_SHARE:
                return False
        return True

    def _times(self, walk: list[Pose]) -> np.ndarray:
        """Frames (K,) float64 of the poses of a walk, by the distances and angles between them."""
        return np.cumsum([0.0, *(self._frames_between(*pair) for pair in pairwise(walk))])

    def _frames_between(self, here: Pose, pose: Pose) -> float:
        distance = float(np.linalg.norm(pose.position_world - here.position_world)) / self._side
        return max(distance / _STEP, _angle(here, pose) / _TURN)

    def _flight(self, walk: list[Pose], frames: int, name: str, speed: float) -> list[Camera]:
        """Cameras on the spline through the walk's poses; a short walk is slowed down.

        speed: factor, at most 1; a slower flight ends before the walk does.
        """
        times = self._times(walk)
        points = np.array([[*pose.position_world, *pose.target_world] for pose in walk])  # (K, 6)
        path = catmull_rom(times, points, np.linspace(0.0, speed * min(times[-1], frames - 1.0), frames))
        return [self._around.camera(row[:3], row[3:], name) for row in path]

    def _is_smooth(self, cameras: list[Camera]) -> bool:
        """Return whether the flight is free and its steps and turns are bounded."""
        positions = np.stack([camera.position_world for camera in cameras])
        return self._around.space.contains_path(positions) and all(
            step_of(*pair) <= MAX_STEP * self._side and turn_of(*pair) <= MAX_TURN for pair in pairwise(cameras)
        )


def _angle(one: Pose, other: Pose) -> float:
    """Angle between the directions of two poses in radians."""
    return float(np.arccos(np.clip(one.forward @ other.forward, -1.0, 1.0)))
