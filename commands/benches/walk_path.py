# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera path straight through the free space of an octree, for scenes without cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import first_hits
from ...patchnet_addon.tracing.viewpoints import FOV, viewpoints
from ...training.evaluation.explorations import catmull_rom
from ...training.evaluation.poses import FreeSpace

_VIEWS = 16  # candidates
_SKY = 0.02  # least open share of the sky, below which a place may be inside a hollow wall
_SKY_FOV, _SKY_PX = float(np.radians(120.0)), (32, 32)
_STEPS = 256  # sampled places along a way
_MOST = 0.6  # longest way, as a share of the surface's extent
_TURN = float(np.radians(20.0))  # left at the start, right at the end


def walk_keys(octree: Octree, size_px: tuple[int, int]) -> Steps[list[Camera]]:
    """Three cameras along the longest free horizontal way through a good view, looking ahead.

    Ways under the open sky are preferred, since without light a hall looks like a hollow wall. The first camera turns
    slightly left, the last slightly right. Raises SceneError without free space.
    """
    views = yield from viewpoints(octree, _VIEWS, size_px)
    space = FreeSpace(octree)
    ways = [_way(space, view) for view in views]
    lengths = np.array([float(np.linalg.norm(end - start)) for start, end in ways])
    under = np.array([_sky(octree, (start + end) / 2.0) > _SKY for start, end in ways])
    best = int(np.argmax(np.where(under | ~under.any(), lengths, -1.0)))
    (start, end), view = ways[best], views[best]
    heading = np.arctan2(view.forward[1], view.forward[0])
    keys = []
    for share, turn in ((0.0, _TURN), (0.5, 0.0), (1.0, -_TURN)):
        place = start + share * (end - start)
        ahead = np.array([np.cos(heading + turn), np.sin(heading + turn), view.forward[2]])
        keys.append(replace(Camera.look_at(place, place + ahead, fov=FOV, size_px=size_px), name="Walk"))
    return keys


def _sky(octree: Octree, place_world: np.ndarray) -> float:
    """Share of open sky above a place."""
    up = Camera.look_at(place_world, place_world + np.array([0.0, 1e-3, 1.0]), fov=_SKY_FOV, size_px=_SKY_PX)
    return float(1.0 - first_hits(octree, up).hit.mean())


def _level(view: Camera) -> np.ndarray:
    """Horizontal direction (3,) of a view."""
    forward = np.array([*np.asarray(view.forward)[:2], 0.0])
    result: np.ndarray = forward / max(float(np.linalg.norm(forward)), 1e-9)
    return result


def _way(space: FreeSpace, view: Camera) -> tuple[np.ndarray, np.ndarray]:
    """End points (3,) of the free way through a view's position, backward and forward, in world units."""
    low, high = space.bounds_world
    steps = np.linspace(0.0, _MOST * float((high - low).max()), _STEPS)[:, None]
    ends = []
    for way in (-_level(view), _level(view)):
        points = np.asarray(view.position_world) + steps * way
        free = space.contains(points) & ((points >= low) & (points < high)).all(axis=1)
        last = int(np.argmin(free)) - 1 if not free.all() else _STEPS - 1
        ends.append(points[max(last, 0)])
    return ends[0], ends[1]


def walk_cameras(keys: Sequence[Camera], frames: int, size: tuple[int, int]) -> list[Camera]:
    """Cameras from key to key at even intervals of time, with the lens of the first key.

    Positions, and targets at distance 1, follow a Catmull-Rom spline.
    """
    times = np.linspace(0.0, len(keys) - 1.0, frames)
    places = np.array([np.concatenate([key.position_world, np.asarray(key.forward)]) for key in keys])
    along = catmull_rom(np.arange(float(len(keys))), places, times)
    fov = 2.0 * np.arctan(keys[0].half_x * size[1] / size[0]) if size[0] > size[1] else 2.0 * np.arctan(keys[0].half_y)
    return [
        replace(
            Camera.look_at(spot[:3], spot[:3] + spot[3:], fov=fov, size_px=size, name="Walk"),
            clip_start=keys[0].clip_start,
            clip_end=keys[0].clip_end,
        )
        for spot in along
    ]
