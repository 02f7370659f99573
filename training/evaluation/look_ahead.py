# SPDX-License-Identifier: GPL-3.0-or-later
"""Look-ahead of the hits of pictures, and the report of a whole camera track (methods 4.1b)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import first_hits


@dataclass(frozen=True)
class TrackReport:
    """Figures of a camera track.

    lookahead_share: of the hits of all frames. hit_share: of all pixels. empty_share: of frames without a hit.
    nearest_world: shortest ray to a hit, inf without hits. largest_step_world, largest_turn (radians): between frames
    that follow each other in one shot, which are those of one name; 0 for one frame.
    """

    frames: int
    shots: int
    lookahead_share: float
    hit_share: float
    empty_share: float
    nearest_world: float
    largest_step_world: float
    largest_turn: float


class LookAhead:
    """Nodes of an octree that have descendants `lookahead` levels down, to count them in pictures."""

    def __init__(self, octree: Octree, lookahead: int) -> None:
        self._octree = octree
        self._ahead = octree.look_ahead(lookahead)

    def count(self, camera: Camera) -> tuple[int, int, float]:
        """Pixels with look-ahead, pixels that hit, and the shortest ray in world units (inf without hits)."""
        hits = first_hits(self._octree, camera)
        nodes = hits.node[hits.hit]
        return int(self._ahead[nodes].sum()), len(nodes), float(hits.t_world.min())

    def share(self, cameras: Sequence[Camera]) -> float:
        """Share of the hits of all cameras; 1 without hits."""
        ahead, hit = np.sum([self.count(camera)[:2] for camera in cameras], axis=0)
        return float(ahead / hit) if hit else 1.0


def track_report(octree: Octree, cameras: Sequence[Camera], *, lookahead: int = 2) -> TrackReport:
    """Measure all frames of a track. Raises SettingError for a track without frames."""
    if not cameras:
        raise SettingError("The camera track has no frames: ask for at least one")
    look_ahead = LookAhead(octree, lookahead)
    ahead, hit, nearest = np.array([look_ahead.count(camera) for camera in cameras]).T
    pairs = [(one, next_one) for one, next_one in pairwise(cameras) if one.name == next_one.name]
    return TrackReport(
        frames=len(cameras),
        shots=1 + sum(one.name != next_one.name for one, next_one in pairwise(cameras)),
        lookahead_share=float(ahead.sum() / hit.sum()) if hit.any() else 1.0,
        hit_share=float(hit.sum() / sum(camera.pixel_count for camera in cameras)),
        empty_share=float(np.mean(hit == 0)),
        nearest_world=float(nearest.min()),
        largest_step_world=max((step_of(*pair) for pair in pairs), default=0.0),
        largest_turn=max((turn_of(*pair) for pair in pairs), default=0.0),
    )


def step_of(one: Camera, other: Camera) -> float:
    """Distance between two cameras in world units."""
    return float(np.linalg.norm(other.position_world - one.position_world))


def turn_of(one: Camera, other: Camera) -> float:
    """Angle of the rotation between two cameras in radians, roll included."""
    axes, other_axes = (np.stack([camera.right, camera.up, camera.forward]) for camera in (one, other))
    return float(np.arccos(np.clip((np.sum(axes * other_axes) - 1.0) / 2.0, -1.0, 1.0)))
