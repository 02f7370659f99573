# SPDX-License-Identifier: GPL-3.0-or-later
"""Warnings about scenes too far from the origin, too small or too large for float32 coordinates.

Blender stores coordinates and Cycles computes light in float32; voxelization uses double precision.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.errors import GeometryError
from ...patchnet_addon.runtime.quantities import named_list
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera

LIFT_SHARE = 2.0**-18  # of the farthest coordinate: least distance from a surface at which Cycles samples light
_LARGEST = 1e15  # squares of longer lengths, with a margin for lamps, overflow single precision
_MIN_LIT, _MAX_LIT = 1e-7, 4e9  # least extent, and greatest distance from the origin; Cycles is wrong beyond them
_COARSE_PLACES, _COARSE_LIGHT = 1 / 16, 1 / 64  # shares of the surface's extent, too coarse for all pictures
_FEW_VOXELS = 2.0
_TO_ORIGIN = "move the scene with its cameras and lights to the origin"


def place_warnings(source: SceneMesh, grid: Grid) -> tuple[str, ...]:
    """Warn if coordinates are coarser than voxels, or if one object is far from all others.

    Raises GeometryError if coordinates are too coarse for any picture.
    """
    reach, name = _farthest(source)
    if reach > _LARGEST:
        raise GeometryError(
            f"Object '{name}' extends {reach:.2g} units from the origin, too far for single precision: "
            "scale the scene down, or leave the object out"
        )
    spacing = float(np.spacing(np.float32(reach)))
    where = f"Object '{name}' is {reach:.2g} units from the origin, where coordinates are rounded to {spacing:.2g}"
    if spacing > _COARSE_PLACES * grid.side_world:
        raise GeometryError(f"{where}, too coarse for a scene {grid.side_world:.2g} units across: {_TO_ORIGIN}")
    if spacing > grid.voxel_size_world:
        return (f"{where}, more than a voxel ({grid.voxel_size_world:.2g}), so edges are displaced: {_TO_ORIGIN}",)
    return _lonely(source, grid)


def light_warnings(source: SceneMesh, grid: Grid) -> tuple[str, ...]:
    """Warn if Cycles samples light a voxel or more off the surface; raises GeometryError if its light is wrong."""
    reach, name = _farthest(source)
    extent = float(np.ptp(source.bounds_world, axis=0).max())
    other = "or choose Light: Two Lights"
    if extent < _MIN_LIT:
        raise GeometryError(
            f"The surface of '{name}' is {extent:.2g} units across; Cycles computes wrong light below {_MIN_LIT:g}: "
            f"scale the scene up, {other}"
        )
    if reach > _MAX_LIT:
        raise GeometryError(
            f"Object '{name}' extends {reach:.2g} units from the origin; Cycles computes wrong light beyond "
            f"{_MAX_LIT:g}: scale the scene down, {other}"
        )
    lift = LIFT_SHARE * reach
    where = f"Object '{name}' is {reach:.2g} units from the origin, where Cycles samples light {lift:.2g} off surfaces"
    if lift > _COARSE_LIGHT * extent:
        raise GeometryError(f"{where}, too far for a scene {extent:.2g} units across: {_TO_ORIGIN}, {other}")
    if lift > grid.voxel_size_world:
        return (f"{where}, more than a voxel ({grid.voxel_size_world:.2g}), so shadows are inexact: {_TO_ORIGIN}",)
    return ()


def _farthest(source: SceneMesh) -> tuple[float, str]:
    """Return the largest coordinate of any axis, and its object."""
    reaches = np.abs(source.boxes_world).max(axis=(1, 2))
    return float(reaches.max()), source.object_names[int(reaches.argmax())]


def _lonely(source: SceneMesh, grid: Grid) -> tuple[str, ...]:
    """Warn if one object is so far away that all others together span at most two voxels."""
    names, boxes = source.object_names, source.boxes_world
    if len(names) < 2:
        return ()
    centres = boxes.mean(axis=1)
    far = int(np.abs(centres - np.median(centres, axis=0)).max(axis=1).argmax())
    others = np.delete(boxes, far, axis=0)
    low, high = others[:, 0].min(axis=0), others[:, 1].max(axis=0)
    gap, extent = float(np.maximum(boxes[far, 0] - high, low - boxes[far, 1]).max()), float((high - low).max())
    if gap < grid.side_world / 2 or extent > _FEW_VOXELS * grid.voxel_size_world:
        return ()
    return (
        f"Object '{names[far]}' is {gap:.2g} units from all other objects, so voxels of {grid.voxel_size_world:.2g} "
        f"are too large for them ({extent:.2g} units across): leave that object out, or move it closer",
    )


def thin_warnings(source: SceneMesh, grid: Grid, cameras: Sequence[Camera]) -> tuple[str, ...]:
    """Warn if hair or points are thinner than a voxel or pixel, and so look too wide."""
    names: list[str] = []
    for part in source.parts:
        if part.mesh.thickness:
            middle = np.ptp(part.mesh.vertices, axis=0) / 2 + part.mesh.vertices.min(axis=0)
            centres = part.matrices_world[:, :3, :3] @ middle.astype(np.float64) + part.matrices_world[:, :3, 3]
            scale = np.cbrt(np.abs(np.linalg.det(part.matrices_world[:, :3, :3])))
            pixels = [camera.pixel_side((centres - camera.position_world) @ camera.forward) for camera in cameras]
            limit = np.maximum(np.min(pixels, axis=0) if pixels else 0.0, grid.voxel_size_world)
            thin = part.mesh.thickness * scale < limit
            names += [name for name, each in zip(part.objects, thin, strict=True) if each]
    if not names:
        return ()
    return (
        f"Hair or points of {named_list(names)} are thinner than a voxel or pixel and look too wide: "
        "choose finer voxels or a larger Picture Size, or Refine with Cycles",
    )
