# SPDX-License-Identifier: GPL-3.0-or-later
"""Survey of sheets before a bake: which are baked on their back, and which a warning names (methods 7.2f).

An opaque sheet has one luminance, that of one side, and so has a closed surface. Cameras say which side of it is seen,
and one small bake how much light falls on both: sheets that are clear are decided as a whole. What stays open shows the
side of its normals; where cameras see the other one, and far more light falls there, normals are perhaps flipped, and a
warning says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import bpy
import numpy as np

from ....patchnet_addon.lightmap.sheet_sides import (
    BLACK,
    CLEAR,
    DARK,
    SheetPoints,
    asked_sheets,
    lit_on_both_sides,
    points_on_sheets,
    turned_sheets,
)
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.quantities import named_list
from ....patchnet_addon.runtime.worker import computed
from ....patchnet_addon.tracing.camera import Camera
from ...scene.scene_mesh import SceneMesh
from ...settings.groups import LightSettings
from .one_sided import is_opaque, one_sided_materials
from .side_probe import light_of_sides

if TYPE_CHECKING:  # it brings numba, which nothing imports before it computes
    from ....patchnet_addon.tracing.seen_triangles import Sight

_MOST_CAMERAS = 16
_SHARE = 0.01  # of the pixels that see something: an object with fewer on its back shows edges, or an open end
_BEHIND = 1.0 / 3.0  # of an object's own pixels: fewer are an open end, and its normals are as they should be
_POINTS = 48  # a camera, on backs that it sees
_NAMED, _NOTED = 4, 20
_MOST_TIMES = 100.0  # that a sentence says: a front may be black


class Sides(NamedTuple):
    """turned: (T,) bool, triangles that are baked on their back. both: (T,) bool, of sheets that are lit on both sides.

    sight: what cameras see. warnings: sentences. notes: plain JSON values.
    """

    turned: np.ndarray
    both: np.ndarray
    sight: Sight
    warnings: tuple[str, ...] = ()
    notes: dict[str, Any] = {}


@dataclass(frozen=True, eq=False)
class _Survey:
    """Sheets of a surface, what cameras see of them, and where their light is measured.

    sheet: (T,) int32, -1 for none. is_open: (S,) bool. may_turn: (T,) bool, of closed sheets and materials of one side.
    areas: (S,) of what may turn. seen: (S, 2) pixels of front and back. asked: (N,) sheets whose light is measured, at
    `points`; backs: (B,) triangles whose back is seen, and at which place (B, 3).
    """

    sheet: np.ndarray
    is_open: np.ndarray
    may_turn: np.ndarray
    areas: np.ndarray
    seen: np.ndarray
    asked: np.ndarray
    points: SheetPoints
    backs: np.ndarray
    back_places: np.ndarray
    sight: Sight


def sides_of_sheets(
    context: bpy.types.Context,
    source: SceneMesh,
    cameras: Sequence[Camera],
    light: LightSettings,
    lift_world: float,
) -> Steps[Sides]:
    """Decide which sheets of `source` are baked on their back, in the light of the context's scene.

    cameras: those that look; of more than 16 as many, spread over them. lift_world: how far off the surface light is
    measured.
    Nothing is measured where nothing is of one side or closed. Raises SceneError, StoppedError.
    """
    at = Progress(0, 1, "Looking at sides of surfaces")
    one_sided = one_sided_materials(source, light)
    survey = yield from computed(lambda: _surveyed(source, cameras, one_sided, warns=not light.both_sides), at)
    if not len(survey.points.triangle) + len(survey.backs):
        none = np.zeros(source.triangle_count, bool)
        return Sides(none, none, survey.sight)
    places, normals = yield from computed(lambda: _places(source, survey), at)
    lit_by = bool(light.daylight)
    measured = yield from light_of_sides(context, places, normals, lift_world, with_daylight=lit_by, at=at)
    return _decided(source, survey, measured)


def _surveyed(source: SceneMesh, cameras: Sequence[Camera], one_sided: np.ndarray, *, warns: bool) -> _Survey:
    """Survey without light. one_sided: (M,) bool, see `one_sided_materials`. warns: whether seen backs matter."""
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals
    from ....patchnet_addon.tracing.seen_triangles import Sight

    sheet, is_open = _placed_sheets(source)
    opaque = np.array([is_opaque(material) for material in source.materials])
    chosen = np.linspace(0, len(cameras) - 1, min(len(cameras), _MOST_CAMERAS)).astype(int)
    sight = Sight([cameras[index] for index in chosen.tolist()])
    may_turn, areas = np.zeros(len(sheet), bool), np.zeros(len(sheet), np.float32)
    for batch in source.batches():
        mine = slice(batch.first_triangle, batch.first_triangle + len(batch))
        areas[mine], _ = triangle_areas_and_normals(batch.corners_world)
        may_turn[mine] = one_sided[batch.materials]
        sight.add(batch.corners_world, opaque[batch.materials], batch.first_triangle)
    backs, places = _seen_backs(source, sight, may_turn) if warns else (np.empty(0, np.int64), np.empty((0, 3)))
    of_open = np.append(is_open, False)[sheet]
    may_turn = (sheet >= 0) & (may_turn | ~of_open)
    areas *= may_turn
    by_sheet = np.bincount(sheet[may_turn], areas[may_turn], len(is_open))
    seen = np.zeros((len(is_open), 2), np.int64)
    hit = sight.seen.triangle >= 0
    triangle, behind = sight.seen.triangle[hit], sight.seen.behind[hit]
    counts = sheet[triangle] >= 0
    np.add.at(seen, (sheet[triangle[counts]], behind[counts].astype(int)), 1)
    asked = asked_sheets(np.where(is_open | (seen[:, 1] > 0), by_sheet, 0.0), seen)
    points = points_on_sheets(asked, sheet, areas)
    return _Survey(sheet, is_open, may_turn, by_sheet, seen, asked, points, backs, places, sight)


def _placed_sheets(source: SceneMesh) -> tuple[np.ndarray, np.ndarray]:
    """(T,) int32, sheet of each placed triangle, other ones in each place, and (S,) bool, whether sheets are open."""
    from ....patchnet_addon.surface.connected import sheets_of

    numbers, is_open, first = [], [], 0
    for part in source.parts:
        own, own_open = sheets_of(part.mesh.vertices, part.mesh.triangles)
        count = len(part.objects)
        starts = first + np.arange(count)[:, None] * len(own_open)
        numbers.append(np.where(own < 0, -1, own + starts).astype(np.int32).ravel())
        is_open.append(np.tile(own_open, count))
        first += count * len(own_open)
    return np.concatenate(numbers), np.concatenate(is_open)


def _seen_backs(source: SceneMesh, sight: Sight, may_warn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (B,) whose back cameras see, and places (B, 3) there, spread over their pictures.

    Of a camera those alone of objects that it sees from behind in more than few pixels. may_warn: (T,) bool.
    """
    triangles, places = [np.empty(0, np.int64)], [np.empty((0, 3))]
    for camera in range(len(sight.seen.triangle)):
        pixels = np.flatnonzero(sight.seen.triangle[camera].ravel() >= 0)
        triangle = sight.seen.triangle[camera].ravel()[pixels]
        behind = sight.seen.behind[camera].ravel()[pixels] & may_warn[triangle]
        own = source.object_numbers(triangle)
        seen, turned = np.bincount(own), np.bincount(own, behind)
        backs = pixels[behind & ((turned >= _SHARE * len(pixels)) & (turned >= _BEHIND * seen))[own]]
        if len(backs):
            backs = backs[np.linspace(0, len(backs) - 1, min(len(backs), _POINTS)).astype(int)]
            triangles.append(sight.seen.triangle[camera].ravel()[backs])
            places.append(sight.places(camera, backs))
    return np.concatenate(triangles), np.concatenate(places)


def _places(source: SceneMesh, survey: _Survey) -> tuple[np.ndarray, np.ndarray]:
    """Places and unit normals (N, 3) in the world: on sheets, then on backs."""
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

    corners, _ = source.corners_and_materials(np.concatenate([survey.points.triangle, survey.backs]))
    one, two = survey.points.barycentric.T[:, :, None]
    start, first, second = (corners[: len(one), i] for i in range(3))
    on_sheets = start + one * (first - start) + two * (second - start)
    return np.concatenate([on_sheets, survey.back_places]), triangle_areas_and_normals(corners)[1]


def _decided(source: SceneMesh, survey: _Survey, measured: np.ndarray) -> Sides:
    """Sides by the light (N, 2) that was measured at the points on sheets, then at seen backs."""
    count, asked = len(survey.points.sheet), survey.asked
    turned, lit = np.zeros((2, len(survey.is_open) + 1), bool)  # the last one: of no sheet
    if count:
        of_sheets = measured[:count].reshape(len(asked), -1, 2).mean(axis=1, dtype=np.float64)
        turned[asked] = turned_sheets(of_sheets, survey.areas[asked], survey.seen[asked])
        lit[asked] = survey.is_open[asked] & lit_on_both_sides(of_sheets)
    of_triangle = turned[survey.sheet] & survey.may_turn
    both = lit[survey.sheet]
    names, is_closed = source.objects_of(survey.backs), ~np.append(survey.is_open, True)[survey.sheet]
    closed = is_closed[survey.backs]
    shown = ~of_triangle[survey.backs]
    named = _brighter_backs(names[shown], measured[count:][shown], closed[shown], float(measured.max(initial=0.0)))
    has_sheets = not set(named) <= set(names[closed].tolist())
    inside_out = _inside_out(source, survey.sheet, np.flatnonzero(of_triangle & is_closed))
    warnings = _sentences(named, inside_out, has_sheets=has_sheets)
    if not turned.any():
        return Sides(of_triangle, both, survey.sight, warnings)
    _, first = np.unique(np.where(of_triangle, survey.sheet, -1), return_index=True)
    objects = sorted(set(source.objects_of(first[of_triangle[first]]).tolist()))
    notes = {"turned_sheets": int(turned.sum()), "turned_objects": objects[:_NOTED]}
    return Sides(of_triangle, both, survey.sight, warnings, notes)


def _brighter_backs(names: np.ndarray, light: np.ndarray, closed: np.ndarray, brightest: float) -> dict[str, float]:
    """Objects whose seen back gets far more light than the front that is shown: names, and how many times as much.

    light: (N, 2) of front and back at N points. closed: (N,) bool, of closed surfaces, which show their inner side
    where no light falls on the outer one.
    """
    found: dict[str, float] = {}
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        front, back = np.median(light[mine], axis=0).tolist()
        taken = closed[mine].all() and front <= BLACK * brightest
        if not taken and back > max(CLEAR * front, DARK * brightest):
            found[name] = back / max(front, back / _MOST_TIMES)
    return found


def _inside_out(source: SceneMesh, sheets: np.ndarray, triangles: np.ndarray) -> list[str]:
    """Names of objects whose normals point inward, of those with these triangles (N,) of whole closed sheets."""
    corners, _ = source.corners_and_materials(triangles)
    volumes = np.linalg.det(corners - source.bounds_world.mean(axis=0))  # which add up to that of a closed surface
    sheet = sheets[triangles]
    return sorted(set(source.objects_of(triangles[np.bincount(sheet, volumes)[sheet] < 0.0]).tolist()))


def _sentences(brighter: dict[str, float], inside_out: list[str], *, has_sheets: bool) -> tuple[str, ...]:
    """Sentences about normals. brighter: see `_brighter_backs`. has_sheets: whether some of these are open."""
    said = []
    if brighter:
        is_seen, looks, its = ("is", "looks", "its") if len(brighter) == 1 else ("are", "look", "their")
        times = float(np.median(list(brighter.values())))
        said.append(
            f"{named_list(brighter, _NAMED)} {is_seen} seen from behind, where {times:.0f} times as much light falls "
            f"as on the side of {its} normals, and {looks} too dark: flip the normals if they are wrong (Mesh > "
            f"Normals){', else bake with Both Sides: On' if has_sheets else ''}"
        )
    if inside_out:
        said.append(
            f"Normals of {named_list(inside_out, _NAMED)} point inward; the side that cameras see was baked: "
            "recalculate them (Mesh > Normals) if other views look wrong"
        )
    return tuple(said)
