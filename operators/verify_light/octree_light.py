# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene as its octree shows it, for Cycles: the same surface, in the same light, cut open at the same plane."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import SceneError
from ..cycles.plane_cut import cut_for_camera
from ..cycles.two_lights import two_lights
from ..scene.read import read_scene
from ..schema.table import TWO_LIGHTS


@contextmanager
def as_in_octree(
    context: bpy.types.Context, octree: Octree, light: str, bisect: tuple[int, float] | None = None
) -> Iterator[None]:
    """Light the open scene as an octree of it that is lit by `light`, within the block; it is as before after it.

    Light that Cycles has baked is the scene's own already, of the whole scene where the octree is cut open: the camera
    alone sees through what lies beyond the plane. bisect: axis and share of that plane. Raises SceneError for an octree
    of another surface or light, and as `two_lights` and `cut_for_camera`.
    """
    from ...patchnet_addon.surface.shading import DIRECTION

    source = read_scene(context.evaluated_depsgraph_get())
    found = octree.provenance.get("light")
    if found != light:
        raise SceneError(f"The octree's light is {found!r}, and the scene's is {light!r}: give an octree in that light")
    wanted, grid = Grid.around(source.bounds_world, octree.grid.depth), octree.grid
    off = np.abs(np.subtract((*wanted.origin_world, wanted.side_world), (*grid.origin_world, grid.side_world)))
    if off.max() > grid.voxel_size_world:
        raise SceneError(
            f"The octree's cube, of side {grid.side_world:g}, is not that around the scene, of side "
            f"{wanted.side_world:g}: give an octree of this scene, without what is left out of it"
        )
    plane = None
    if bisect is not None:
        axis, share = bisect
        low, high = source.bounds_world[:, axis]
        plane = axis, float(low + share * (high - low))
    with ExitStack() as stack:
        if light == TWO_LIGHTS:
            stack.enter_context(two_lights(context.scene, source.material_names, DIRECTION, plane))
        elif plane is not None:
            stack.enter_context(cut_for_camera(context.scene, source.material_names, plane))
        yield
