# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets of a scene's surface, and the sides of them that get light (methods 7.2f)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..surface.scene_mesh import SceneMesh
from ..surface.sides import LIT_BACK, LIT_BOTH, LIT_FRONT, faces_of
from ..surface.triangles import triangle_areas_and_normals
from ..tracing.camera import Camera

if TYPE_CHECKING:
    from .sheets import Sheets

_MOST_HOLDERS = 256  # placed meshes, the largest ones, that may hold others


def placed_sheets(source: SceneMesh, cameras: Sequence[Camera], two_sided: np.ndarray) -> Sheets:
    """Sheets of the placed triangles, and the sides that get light, as `cameras` may see them.

    Closed sheets get it outside, or inside if a camera is there; without cameras also inside if other objects are
    there. Open ones, and those of `two_sided` (M,) materials, get it on both sides.
    """
    from .sheets import Sheets, add_volumes

    sheet, is_open, placement = _numbered(source)
    volumes, origin = np.zeros(len(is_open)), source.bounds_world.mean(axis=0)
    through, face = np.zeros(len(sheet), bool), np.zeros(len(sheet), np.uint8)
    for batch in source.batches():
        here = slice(batch.first_triangle, batch.first_triangle + len(batch))
        add_volumes(batch.corners_world, sheet[here], origin, volumes)
        through[here] = two_sided[batch.materials]
        face[here] = faces_of(triangle_areas_and_normals(batch.corners_world)[1])
    outer = np.where(volumes >= 0.0, LIT_FRONT, LIT_BACK)
    some_within, some_outside = _places_of(cameras, source, sheet, ~is_open, placement)
    lit = np.where(is_open | (some_within & some_outside), LIT_BOTH, np.where(some_within, -outer, outer))
    of_triangle = np.append(lit, LIT_BOTH).astype(np.int8)[sheet]  # the last is of triangles without a sheet
    of_triangle[through] = LIT_BOTH
    return Sheets(sheet, of_triangle, face)


def _numbered(source: SceneMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T,) int32, sheet of each placed triangle; (S,) bool, whether it is open; (S,) int64, number of its placement."""
    from .sheets import sheets_of

    numbers, is_open, placement, first, placed = [], [], [], 0, 0
    for part in source.parts:
        own, own_open = sheets_of(part.mesh.vertices, part.mesh.triangles)
        count = len(part.objects)
        starts = first + np.arange(count)[:, None] * len(own_open)
        numbers.append(np.where(own < 0, -1, own + starts).astype(np.int32).ravel())
        is_open.append(np.tile(own_open, count))
        placement.append(placed + np.repeat(np.arange(count), len(own_open)))
        first, placed = first + count * len(own_open), placed + count
    return np.concatenate(numbers), np.concatenate(is_open), np.concatenate(placement)


def _places_of(
    cameras: Sequence[Camera], source: SceneMesh, sheet: np.ndarray, closed: np.ndarray, placement: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(S,) bool each: sheets with a camera within, which only `closed` ones have, and with one outside."""
    from .sheets import add_solid_angles

    if not cameras:
        return _holds_others(source)[placement] & closed, np.ones(len(closed), bool)
    eyes = np.array([camera.position_world for camera in cameras], np.float64).reshape(-1, 3)
    low, high = source.boxes_world[:, 0, None], source.boxes_world[:, 1, None]
    in_box = ((eyes > low) & (eyes < high)).all(axis=-1)[placement] & closed[:, None]  # (S, E)
    asked = np.flatnonzero(in_box.any(axis=1))
    within = np.zeros((len(asked), len(eyes)))
    if len(asked):
        number = np.full(len(closed) + 1, -1, np.int32)
        number[asked] = np.arange(len(asked))
        for batch in source.batches():
            own = number[sheet[batch.first_triangle : batch.first_triangle + len(batch)]]
            add_solid_angles(batch.corners_world, own, eyes, in_box[asked], within)
    inside = np.abs(within) > 2.0 * np.pi
    some_within, some_outside = np.zeros(len(closed), bool), np.ones(len(closed), bool)
    some_within[asked], some_outside[asked] = inside.any(axis=1), ~inside.all(axis=1)
    return some_within, some_outside


def _holds_others(source: SceneMesh) -> np.ndarray:
    """(P,) bool: placed meshes whose box holds that of another one."""
    low, high = source.boxes_world[:, 0], source.boxes_world[:, 1]
    size = (high - low).prod(axis=1)
    found = np.zeros(len(low), bool)
    order = np.argsort(-size)[:_MOST_HOLDERS]
    for place in order.tolist():
        inside = ((low >= low[place]) & (high <= high[place])).all(axis=1)
        inside[place] = False
        found[place] = inside.any()
    return found
