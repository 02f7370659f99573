# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewpoint of a figure, chosen by rule: of the ends of approaches to a model, the one whose picture is most wrong."""

from __future__ import annotations

import numpy as np

from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.render import first_hits
from ....patchnet_addon.tracing.supersample import supersample
from ..approaches import Approaches
from ..free_space import FreeSpace
from ..look_ahead import LookAhead
from ..poses import Lens

APPROACHES = 5  # as many as a camera track of an evaluation has
_FRAMES = 200  # of each
_SIDE = 8  # rays of the pictures that tell which is most wrong
_LABEL = "Looking for a viewpoint"


def hardest_end(
    octree: Octree, size_px: tuple[int, int], *, lookahead: int = DEFAULT_LOOKAHEAD, seed: int = 0
) -> Steps[Camera]:
    """Camera at the end of one of five approaches, as near as there is look-ahead on 95 % of hits.

    The squared error of the preview, summed over the picture, is the largest there, against 8 x 8 rays a pixel. Raises
    SceneError if nothing is seen from far.
    """
    yield Progress(0, APPROACHES, _LABEL)
    space, lens, look_ahead = FreeSpace(octree), Lens.of(octree, size_px, lookahead), LookAhead(octree, lookahead)
    approaches = Approaches(octree, space, lens, look_ahead, np.random.default_rng(seed))
    ends = []
    for number in range(1, APPROACHES + 1):
        end = approaches.shot(number, APPROACHES, _FRAMES)[-1]
        truth = yield from supersample(octree, end, _SIDE)
        ends.append((float(np.sum((first_hits(octree, end).luminance - truth) ** 2.0)), number, end))
        yield Progress(number, APPROACHES, _LABEL)
    return max(ends, key=lambda end: end[:2])[2]
