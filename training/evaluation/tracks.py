# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera tracks of an evaluation: half of the frames approach the model from far, half explore its details.

The paper takes 2,000 frames of 130 x 130 pixels for each scene (methods 4.1b, 7.26). A track needs nothing but the
octree, and is the same for the same octree and seed. It is made of shots of about 200 frames: within one, cameras have
one name and pictures that follow each other look alike; between two is a cut.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from .approaches import Approaches
from .explorations import Explorations
from .free_space import FreeSpace
from .look_ahead import LookAhead
from .poses import Lens

_SHOT = 200  # frames, about


def camera_track(
    octree: Octree,
    *,
    frames: int = 2000,
    size_px: tuple[int, int] = (130, 130),
    lookahead: int = DEFAULT_LOOKAHEAD,
    seed: int = 0,
) -> Steps[list[Camera]]:
    """Lay a track of `frames` cameras: approaches in the first half, explorations in the second.

    No camera is in an occupied voxel or within four finest voxels of one, nor on the way from frame to frame. Cameras
    keep so far from what they see that at least 95 % of hits have look-ahead where the scene has room for that:
    `track_report` tells the share. An approach starts three cube sides away and comes nearer by the same factor at each
    frame, 1.3 % in 200 frames; an exploration moves at most 0.01 cube sides and turns at most 3 degrees a frame.

    octree: with leaves on one level. seed: of the choice of targets and poses. Raises SettingError for fewer than two
    frames or less depth than `lookahead`, SceneError if there is no room or nothing to be seen.
    """
    if frames < 2:
        raise SettingError(f"A camera track of {frames} frames has no two halves: ask for at least 2")
    if octree.depth <= lookahead:
        raise SettingError(f"An octree of depth {octree.depth} has no look-ahead of {lookahead} levels: use more depth")
    yield Progress(0, frames, "Looking for poses")
    space, lens, look_ahead = FreeSpace(octree), Lens.of(octree, size_px, lookahead), LookAhead(octree, lookahead)
    near_random, far_random = np.random.default_rng(seed).spawn(2)
    approaches = Approaches(octree, space, lens, look_ahead, far_random)
    explorations = Explorations(octree, space, lens, look_ahead, near_random)
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
    """Frames of each shot, as even as can be."""
    count = max(1, round(frames / _SHOT))
    return [frames * (number + 1) // count - frames * number // count for number in range(count)]
