# SPDX-License-Identifier: GPL-3.0-or-later
"""Backs of surfaces that cameras see, which are in other light than the voxels show: normals that are perhaps flipped.

An opaque surface has the light of the side that its normals show, unless that gets next to none (methods 7.2f). Where a
camera sees the other side, the light of both is measured at a few points, and a warning names the objects on which it
differs by far. Light alone cannot decide there: a wall whose normals point into a dim room is right, though the sun
shines on its back.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.log import event
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from ..cycles.bake.baker import is_opaque
from ..cycles.bake.side_probe import light_of_sides
from ..cycles.daylight import has_light
from ..scene.precision import LIFT_SHARE
from ..scene.scene_mesh import SceneMesh
from ..scene_access.own import is_own
from ..settings.groups import LightSettings
from .views import View

DIFFERS = 2.5  # times the light of the other side
_TAKEN_OVER = 0.02  # of the back's light: a front below that has the back's, see `cycles/bake/baker.py`
_SHARE = 0.01  # of the pixels that see something: fewer are edges
_POINTS = 48  # a camera
_NAMED = 4
_NEXT_TO_NONE = 1e-3  # of the brightest point
_TURNED, _ALIGNED = 0.2, 0.5  # normal along the ray at least; length of a voxel's mean normal, shorter at edges
_NEAR_VOXELS = 3.0


class SeenPoint(NamedTuple):
    """Point of a surface whose back a camera sees: place and unit normal in the world, and the object's name."""

    place: np.ndarray
    normal: np.ndarray
    name: str


def back_warnings(
    context: bpy.types.Context, source: SceneMesh, views: Sequence[View], light: LightSettings
) -> Steps[tuple[str, ...]]:
    """Sentence about objects of which cameras see a side that gets far more light than the one that voxels show.

    source: the surface that `views` show. light: its settings. Nothing is measured unless a camera sees backs of opaque
    surfaces in one of a hundred pixels. Raises StoppedError.
    """
    if not light.is_baked or light.both_sides or not views:
        return ()
    pairs = zip(source.material_names, source.materials, strict=True)
    opaque = {name for name, material in pairs if is_opaque(material)}
    points = [point for view in views for point in _seen_backs(context, view, opaque)]
    if not points:
        return ()
    places, normals = (np.array([getattr(point, name) for point in points]) for name in ("place", "normal"))
    lift = max(1e-3 * views[0].octree.grid.voxel_size_world, LIFT_SHARE * float(np.abs(places).max()))
    daylight = not has_light(context.evaluated_depsgraph_get()) if light.daylight is None else light.daylight
    at = Progress(0, 1, "Looking at backs of surfaces")
    try:
        measured = yield from light_of_sides(context, places, normals, lift, with_daylight=daylight, at=at)
    except SceneError as error:  # the pictures are there: a hint is not worth losing them
        event("warning", f"Backs of surfaces could not be looked at: {error}", logging.WARNING)
        return ()
    names = _brighter_backs(points, measured)
    return (_sentence(names),) if names else ()


def _seen_backs(context: bpy.types.Context, view: View, opaque: set[str]) -> list[SeenPoint]:
    """Find points on backs that a view sees, spread over its picture; none if there are few such pixels.

    opaque: names of materials.
    """
    hits, octree = view.buffers.hits, view.octree
    met = np.flatnonzero(hits.hit)
    normals = octree.normal_float(hits.node[met])
    length = np.linalg.norm(normals, axis=1)
    along = np.einsum("pc,pc->p", normals, hits.direction[met])
    backs = met[(length > _ALIGNED) & (along > _TURNED * length)]
    if len(backs) < max(_SHARE * len(met), 1):
        return []
    chosen = backs[np.linspace(0, len(backs) - 1, min(len(backs), _POINTS)).astype(int)]
    depsgraph = context.evaluated_depsgraph_get()
    found = []
    for pixel in chosen.tolist():
        side = octree.grid.side_world / 2.0 ** int(hits.level[pixel])
        origin = _origin(view.camera, pixel)
        point = _cast(context.scene, depsgraph, (origin, hits.direction[pixel].astype(np.float64)), opaque)
        if point is None:
            continue
        far = float(np.linalg.norm(point.place - origin))
        if abs(far - float(hits.t_world[pixel])) < _NEAR_VOXELS * side:
            found.append(point)
    return found


def _cast(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, ray: tuple[np.ndarray, np.ndarray], opaque: set[str]
) -> SeenPoint | None:
    """First surface that a ray (origin, direction) meets, if it is opaque and seen from its back."""
    origin, toward = ray
    met, place, normal, index, item, _ = scene.ray_cast(depsgraph, origin.tolist(), toward.tolist())
    if not met or item is None or is_own(item) or float(np.dot(normal, toward)) <= 0.0:
        return None
    if not _is_of(item.evaluated_get(depsgraph), index, opaque):
        return None
    return SeenPoint(np.array(place), np.array(normal) / np.linalg.norm(normal), item.name)


def _is_of(item: bpy.types.Object, face: int, materials: set[str]) -> bool:
    """Return whether a face of an evaluated object has one of the materials by name, or is of no mesh or has none."""
    if not isinstance(item.data, bpy.types.Mesh) or not 0 <= face < len(item.data.polygons):
        return True
    number = item.data.polygons[face].material_index
    material = item.material_slots[number].material if number < len(item.material_slots) else None
    return material is None or material.original.name_full in materials


def _origin(camera: Camera, pixel: int) -> np.ndarray:
    """Place (3,) in the world where the ray of a pixel's centre begins."""
    if camera.kind != ORTHOGRAPHIC:
        return np.asarray(camera.position_world, np.float64)
    row, column = divmod(pixel, camera.width_px)
    x = (2.0 * (column + 0.5) / camera.width_px - 1.0 + camera.shift_x) * camera.half_x
    y = (2.0 * (row + 0.5) / camera.height_px - 1.0 + camera.shift_y) * camera.half_y
    place: np.ndarray = np.asarray(camera.position_world) + x * np.asarray(camera.right) + y * np.asarray(camera.up)
    return place


def _brighter_backs(points: Sequence[SeenPoint], light: np.ndarray) -> dict[str, float]:
    """Objects whose seen side gets far more light than the one that is baked: names, and how many times as much.

    light: (N, 2) of the side of the normals, which is baked, and of the other, which is seen.
    """
    least = _NEXT_TO_NONE * float(light.max(initial=0.0))
    found: dict[str, float] = {}
    for name in dict.fromkeys(point.name for point in points):
        mine = light[[point.name == name for point in points]]
        baked, seen = np.median(mine, axis=0).tolist()
        if baked > _TAKEN_OVER * seen and seen > max(DIFFERS * baked, least):
            found[name] = seen / baked
    return found


def _sentence(names: dict[str, float]) -> str:
    listed = [f"'{name}'" for name in names]
    text = ", ".join(listed[:_NAMED]) + (f" and {len(listed) - _NAMED} more" if len(listed) > _NAMED else "")
    times = float(np.median(list(names.values())))
    return (
        f"{text} is seen from behind, where {times:.0f} times as much light falls as on the side of its normals, and "
        "looks too dark: flip the normals if they are wrong (Mesh > Normals), else bake with Both Sides (--both-sides)"
    )
