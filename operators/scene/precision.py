# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether single precision, in which Blender keeps places and Cycles computes light, resolves a surface.

Voxels themselves are made in double precision, from the meshes' own coordinates and the objects' transforms.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.errors import GeometryError
from ...patchnet_addon.octree.grid import Grid
from .scene_mesh import SceneMesh

LIFT_SHARE = 2.0**-18  # of the farthest coordinate: that far off a surface Cycles takes its light at least
_LARGEST = 1e15  # squares of lengths beyond it do not fit into single precision any more, with room for a light's
_LEAST_LIT, _MOST_LIT = 1e-7, 4e9  # across, and from the origin: beyond them Cycles was seen to be wrong
_COARSE_PLACES, _COARSE_LIGHT = 1 / 16, 1 / 64  # shares of the surface's extent that are too coarse for any picture
_TO_ORIGIN = "move the scene, with its cameras and lamps, to the origin"


def place_warnings(source: SceneMesh, grid: Grid) -> tuple[str, ...]:
    """A sentence if places are coarser than the grid's voxels. Raises GeometryError where nothing could be seen."""
    reach, name = _farthest(source)
    if reach > _LARGEST:
        raise GeometryError(
            f"Object '{name}' reaches {reach:.2g} from the origin, more than single precision can compute with: "
            "scale the scene down, or leave the object out"
        )
    spacing = float(np.spacing(np.float32(reach)))
    where = f"Object '{name}' lies {reach:.2g} from the origin, where Blender's numbers are {spacing:.2g} apart"
    if spacing > _COARSE_PLACES * grid.side_world:
        raise GeometryError(f"{where}, and all that is seen is {grid.side_world:.2g} across: {_TO_ORIGIN}")
    if spacing > grid.voxel_world:
        return (
            f"{where}, more than a voxel ({grid.voxel_world:.2g}): cameras and vertices stand no finer than that; "
            f"{_TO_ORIGIN}",
        )
    return ()


def light_warnings(source: SceneMesh, grid: Grid) -> tuple[str, ...]:
    """A sentence if Cycles' light is coarser than the grid's voxels. Raises GeometryError where it would be wrong."""
    reach, name = _farthest(source)
    extent = float(np.ptp(source.bounds_world, axis=0).max())
    other = "or choose the two-lights shading"
    if extent < _LEAST_LIT:
        raise GeometryError(
            f"The surface of '{name}' is {extent:.2g} across: Cycles lights nothing below {_LEAST_LIT:g} rightly; "
            f"scale the scene up, {other}"
        )
    if reach > _MOST_LIT:
        raise GeometryError(
            f"Object '{name}' reaches {reach:.2g} from the origin: Cycles lights nothing beyond {_MOST_LIT:g} rightly; "
            f"scale the scene down, {other}"
        )
    lift = LIFT_SHARE * reach
    where = f"Object '{name}' lies {reach:.2g} from the origin, where Cycles takes light {lift:.2g} off the surface"
    if lift > _COARSE_LIGHT * extent:
        raise GeometryError(f"{where}, and all that is lit is {extent:.2g} across: {_TO_ORIGIN}, {other}")
    if lift > grid.voxel_world:
        return (f"{where}, farther than a voxel ({grid.voxel_world:.2g}): shadows are less exact; {_TO_ORIGIN}",)
    return ()


def _farthest(source: SceneMesh) -> tuple[float, str]:
    """The farthest coordinate of any axis, and the object that it belongs to."""
    reach = float(np.abs(source.bounds_world).max())
    best, name = -1.0, ""
    for part in source.parts:
        vertices = part.mesh.vertices.astype(np.float64)
        corners = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
        box = np.stack(np.meshgrid(*corners.T, indexing="ij"), axis=-1).reshape(-1, 3)
        for matrix, item in zip(part.matrices_world, part.objects, strict=True):
            far = float(np.abs(box @ matrix[:3, :3].T + matrix[:3, 3]).max())
            if far > best:
                best, name = far, item
    return reach, name
