# SPDX-License-Identifier: GPL-3.0-or-later
"""Pass over all frames of an animation before the first one is made, for what they have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.bounds import MAX_DEPTH
from ...patchnet_addon.runtime.frames import errors_of_frame
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ..cycles.daylight import has_light
from ..scene.read import read_scene
from ..scene_access.frames import go_to_frame
from ..settings.groups import Bounds
from .frame_maker import FrameMaker


def same_daylight(context: bpy.types.Context, frames: Sequence[int]) -> Steps[bool]:
    """Test that no frame has a light, so that sun and sky are needed: not in the dark frames of a scene with lamps."""
    for done, frame in enumerate(frames):
        yield Progress(done, len(frames), "Looking for light")
        go_to_frame(context.scene, frame)
        if has_light(context.evaluated_depsgraph_get()):
            return False
    return True


def same_grid(context: bpy.types.Context, frames: Sequence[int], maker: FrameMaker) -> Steps[tuple[Bounds, int | None]]:
    """Bounds around the surface at all frames, and the depth over them that the most demanding frame needs.

    The depth is None where settings say it. It is the next smaller one where memory bounds a frame.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    sides: list[float] = []
    bounded = False
    for done, frame in enumerate(frames):
        label = f"One grid for all frames: frame {frame}"
        yield Progress(done, len(frames), label)
        go_to_frame(context.scene, frame)
        with errors_of_frame(frame):
            source = read_scene(context.evaluated_depsgraph_get(), maker.scope)
            needed = yield from labelled(maker.voxel_size_world(context, source), label)
        low, high = np.minimum(low, source.bounds_world[0]), np.maximum(high, source.bounds_world[1])
        if needed is not None:
            sides.append(needed[0])
            bounded = bounded or needed[1]
    bounds = (_corner(low), _corner(high))
    if not sides:
        return bounds, None
    levels = math.log2(Grid.around(np.array(bounds), 1).side_world / min(sides))
    depth = math.floor(levels + 1e-6) if bounded else math.ceil(levels - 1e-6)
    return bounds, min(max(depth, 1), MAX_DEPTH)


def _corner(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
