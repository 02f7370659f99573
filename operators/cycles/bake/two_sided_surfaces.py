# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of the sides of sheets to bake, by their light (methods 7.2f).

One small bake measures the light on both sides of opaque sheets. Sheets with light on both sides are baked on both; a
solid's inside and the back of a building's wall are dark and cost nothing. Voxels without sides show the front, or the
back of sheets that cameras see only from behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import bpy
import numpy as np

from ....patchnet_addon.lightmap.sheet_sides import SheetPoints, asked_sheets, lit_sides, points_on_sheets
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.worker import computed
from ....patchnet_addon.tracing.camera import Camera
from ...scene.scene_mesh import SceneMesh
from ...settings.groups import LightSettings
from ..daylight import emits
from .one_sided import is_opaque, materials_that, one_sided_materials
from .side_probe import light_of_sides

if TYPE_CHECKING:  # it brings numba, which nothing imports before it computes
    from ....patchnet_addon.tracing.seen_triangles import Sight

_MOST_CAMERAS = 16
_SEEN_BEHIND = 0.9  # share of a sheet's pixels that show its back, from which on cameras see only that


class SidePlan(NamedTuple):
    """Baked sides of each placed triangle.

    facing: (T,) int8, 1 the front, -1 the back, 0 both. is_behind: (T,) bool, cameras see only the back.
    is_measured: (T,) bool, by measured light. pieces: (T,) int32, number of the closed sheet, -1 for none.
    sight: the triangles that cameras see.
    """

    facing: np.ndarray
    is_behind: np.ndarray
    is_measured: np.ndarray
    pieces: np.ndarray
    sight: Sight


class _Survey(NamedTuple):
    """Sheets of a surface, and the points of measurement.

    sheet: (T,) int32, -1 for none. is_open, is_behind: (S,) bool. areas: (S,) of triangles with one side. asked: (N,)
    sheets whose light is measured, at `points`.
    """

    sheet: np.ndarray
    is_open: np.ndarray
    is_behind: np.ndarray
    areas: np.ndarray
    asked: np.ndarray
    points: SheetPoints
    sight: Sight


def plan_sides(
    context: bpy.types.Context,
    source: SceneMesh,
    cameras: Sequence[Camera],
    light: LightSettings,
    lift_world: float,
) -> Steps[SidePlan]:
    """Decide which sides of `source` are baked, in the light of the context's scene.

    cameras: of the job, of which 16 at most are used, evenly chosen; closed sheets that they see from within are
    measured, too. lift_world: distance off the surface at which light is measured. If all is closed and seen from
    outside, nothing is measured. Raises SceneError, StoppedError.
    """
    at = Progress(0, 1, "Inspecting sides of surfaces")
    one_sided = one_sided_materials(source)
    survey = yield from computed(lambda: _surveyed(source, cameras, one_sided), at)
    measured = np.empty((0, 2))
    if len(survey.points.triangle):
        places, normals = yield from computed(lambda: _places(source, survey.points), at)
        lit_by = bool(light.daylight)
        measured = yield from light_of_sides(context, places, normals, lift_world, with_daylight=lit_by, at=at)
    return (yield from computed(lambda: _planned(source, survey, measured, light), at))


def _surveyed(source: SceneMesh, cameras: Sequence[Camera], one_sided: np.ndarray) -> _Survey:
    """Survey before the measurement. one_sided: (M,) bool, see `one_sided_materials`."""
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals
    from ....patchnet_addon.tracing.seen_triangles import Sight

    sheet, is_open = _placed_sheets(source)
    opaque = np.array([is_opaque(material) for material in source.materials])
    chosen = np.linspace(0, len(cameras) - 1, min(len(cameras), _MOST_CAMERAS)).astype(int)
    sight = Sight([cameras[index] for index in chosen.tolist()])
    areas = np.zeros(len(sheet), np.float32)
    for batch in source.batches():
        mine = slice(batch.first_triangle, batch.first_triangle + len(batch))
        areas[mine] = triangle_areas_and_normals(batch.corners_world)[0] * one_sided[batch.materials]
        sight.add(batch.corners_world, opaque[batch.materials], batch.first_triangle)
    areas *= sheet >= 0
    by_sheet = np.bincount(np.maximum(sheet, 0), areas, len(is_open))
    met = sight.seen.triangle >= 0
    seen, behind = sheet[sight.seen.triangle[met]], sight.seen.behind[met]
    backs = np.bincount(seen[behind & (seen >= 0)], minlength=len(is_open))
    is_behind = (backs > 0) & (backs >= _SEEN_BEHIND * np.bincount(seen[seen >= 0], minlength=len(is_open)))
    asked = asked_sheets(np.where(is_open | (backs > 0), by_sheet, 0.0))
    return _Survey(sheet, is_open, is_behind, by_sheet, asked, points_on_sheets(asked, sheet, areas), sight)


def _placed_sheets(source: SceneMesh) -> tuple[np.ndarray, np.ndarray]:
    """(T,) int32, sheet of each placed triangle, numbered per placement, and (S,) bool, whether sheets are open."""
    from ....patchnet_addon.lightmap.sheet_sides import sheets_of

    numbers, is_open, first = [], [], 0
    for part in source.parts:
        own, own_open = sheets_of(part.mesh.vertices, part.mesh.triangles)
        count = len(part.objects)
        starts = first + np.arange(count)[:, None] * len(own_open)
        numbers.append(np.where(own < 0, -1, own + starts).astype(np.int32).ravel())
        is_open.append(np.tile(own_open, count))
        first += count * len(own_open)
    return np.concatenate(numbers), np.concatenate(is_open)


def _places(source: SceneMesh, points: SheetPoints) -> tuple[np.ndarray, np.ndarray]:
    """Positions and unit normals (N, 3) of points in the world."""
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

    corners, _ = source.corners_and_materials(points.triangle)
    one, two = points.barycentric.T[:, :, None]
    start, first, second = (corners[:, corner] for corner in range(3))
    return start + one * (first - start) + two * (second - start), triangle_areas_and_normals(corners)[1]


def _planned(source: SceneMesh, survey: _Survey, measured: np.ndarray, light: LightSettings) -> SidePlan:
    """Sides by the light (N, 2) measured at the points."""
    closed = np.append(~survey.is_open, False)[survey.sheet]  # the last entry is for triangles of no sheet
    of_sheet = np.append(np.where(survey.is_open, 0, 1), 0).astype(np.int8)
    if len(survey.asked):
        of_sheets = measured.reshape(len(survey.asked), -1, 2).mean(axis=1, dtype=np.float64)
        of_sheet[survey.asked] = lit_sides(of_sheets, survey.areas[survey.asked])
    has_one = one_sided_materials(source)
    has_one_lit = has_one & ~materials_that(emits, source)  # an emitter may shine only on its back
    facing = np.where(closed, 1, 0).astype(np.int8)
    is_behind = np.append(survey.is_behind, False)[survey.sheet]
    for batch in source.batches():
        mine = slice(batch.first_triangle, batch.first_triangle + len(batch))
        decided = of_sheet[survey.sheet[mine]]
        if not light.has_sides:
            decided = np.where(decided == 0, np.where(is_behind[mine], np.int8(-1), np.int8(1)), decided)
        chosen = has_one[batch.materials] & (has_one_lit[batch.materials] | closed[mine])
        facing[mine] = np.where(chosen, decided, facing[mine])
    is_measured = np.isin(survey.sheet, survey.asked)
    return SidePlan(facing, is_behind, is_measured, np.where(closed, survey.sheet, -1).astype(np.int32), survey.sight)
