# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair and points as triangles: hair curves, particle hair and point clouds, which have no mesh.

Cycles renders a strand as a ribbon that faces each ray, or as a round tube, and a point as a sphere. Here they are
tubes and spheres of flat triangles of the same apparent width. Light is baked on them while the hair is in the scene.
Rays that start inside a ribbon or a sphere of Cycles do not hit it, rays inside a round tube do, so bakes render hair
as ribbons.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import bpy
import numpy as np

from ...patchnet_addon.runtime.quantities import named_list
from ...patchnet_addon.surface.local_mesh import LocalMesh, packed_normals
from ...patchnet_addon.surface.tubes import curve_middles, segments, sphere_triangles, spheres, tube_triangles, tubes
from ..scene_access.blender_version import POLYLINES_ARE_STRAIGHT
from ..state.digest import ATTRIBUTE_KINDS, values_of
from .layer_names import GENERATED
from .local_mesh import generated_from_position

Key = tuple[object, ...]
STRANDS = frozenset({"CURVES", "POINTCLOUD"})  # types of objects
FINE_TRIANGLES, MOST_TRIANGLES = 200_000, 1_000_000  # of all hair and points of a scene
_RADII = {"CURVES": 0.005, "POINTCLOUD": 0.01}  # Cycles' defaults without an attribute
_DETAILS = ((7, 2), (5, 1), (3, 0))  # sides of tubes, divisions of spheres
_LEAST_BEND = 0.1  # least distance from the chord, in radii, of segments to divide
_MOST_DIVIDED = 20_000  # points of an object, beyond which its strands are not divided
_POLYLINE = 1  # in the enumeration of curve types
_UVS = ""  # layer of the default UV coordinates of renders
_MOST_READ = 500_000  # strands of a particle system; Blender's API returns their points one by one


@dataclass(frozen=True, eq=False)
class Strands:
    """Strands, or points, of one object in its own space.

    points: (P, 3) float32. radii: (P,) float32. first: (S + 1,) int64, strand s has points first[s] to first[s + 1].
    uvs: (P, 2) float32 or None. layers: (P, C) float32, see `LocalMesh`. slot: of the material.
    spheres: each point is a sphere, and a strand of its own. straight: strands have no curve between their points.
    damaged: strands are left out, whose points are not finite numbers.
    """

    name: str
    points: np.ndarray
    radii: np.ndarray
    first: np.ndarray
    uvs: np.ndarray | None
    layers: dict[str, np.ndarray]
    slot: int = 0
    spheres: bool = False
    straight: bool = False
    damaged: bool = False

    def __len__(self) -> int:
        return len(self.first) - 1

    def triangle_count(self, detail: int) -> int:
        """Count of triangles of `mesh`."""
        sides, divisions = _DETAILS[detail]
        if self.spheres:
            return sphere_triangles(len(self.points), divisions)
        return tube_triangles(len(self.points), len(self.first) - 1, sides)

    def only(self, chosen: np.ndarray) -> Strands:
        """Strands `chosen` (N,) by number."""
        lengths = np.diff(self.first)[chosen]
        first = np.concatenate([[0], np.cumsum(lengths)])
        return self._of_points(np.repeat(self.first[chosen] - first[:-1], lengths) + np.arange(first[-1]), first)

    def _of_points(self, rows: np.ndarray, first: np.ndarray) -> Strands:
        uvs = None if self.uvs is None else self.uvs[rows]
        layers = {name: values[rows] for name, values in self.layers.items()}
        return replace(self, points=self.points[rows], radii=self.radii[rows], first=first, uvs=uvs, layers=layers)

    def divided(self) -> Strands:
        """Divide bent strands, unless they are too many, at the middles of segments on the curves that Cycles draws.

        Straight segments are separated at their points: a tube around a sharp corner is too narrow there.
        """
        if self.spheres or len(self.points) > _MOST_DIVIDED:
            return self
        starts = segments(self.first)
        begins, ends, middles = self.points[starts], self.points[starts + 1], curve_middles(self.points, self.first)
        chords = np.maximum(np.linalg.norm(ends - begins, axis=1), 1e-30)
        bends = np.linalg.norm(np.cross(middles - begins, ends - begins), axis=1) / chords  # distances from the chords
        if bends.mean() <= _LEAST_BEND * self.radii.mean():
            return self
        if self.straight:
            return self._of_points(np.stack([starts, starts + 1], axis=1).ravel(), 2 * np.arange(len(starts) + 1))

        def filled(values: np.ndarray) -> np.ndarray:
            return np.insert(values, starts + 1, (values[starts] + values[starts + 1]) / 2.0, axis=0)

        return replace(
            self,
            points=np.insert(self.points, starts + 1, middles, axis=0),
            radii=filled(self.radii),
            first=2 * self.first - np.arange(len(self.first)),
            uvs=None if self.uvs is None else filled(self.uvs),
            layers={name: filled(values) for name, values in self.layers.items()},
        )

    def thinned(self, share: float) -> Strands:
        """Share of the strands, evenly chosen and widened to cover as much."""
        count = len(self.first) - 1
        kept = max(1, round(count * share))
        if kept >= count:
            return self
        width = (count / kept) ** (0.5 if self.spheres else 1.0)
        return replace(left := self.only(np.arange(kept) * count // kept), radii=left.radii * np.float32(width))

    def mesh(self, detail: int) -> LocalMesh:
        """Closed tubes or spheres; `detail` 0 has most triangles, 2 fewest."""
        sides, divisions = _DETAILS[detail]
        if self.spheres:
            made = spheres(self.points, self.radii, divisions)
        else:
            made = tubes(self.points, self.radii, self.first, sides)
        of_corner = made.points[made.triangles]
        return LocalMesh(
            name=self.name,
            vertices=made.vertices,
            triangles=made.triangles,
            uvs=None if self.uvs is None else self.uvs[of_corner],
            slots=np.full(len(made.triangles), self.slot, np.int16) if self.slot else None,
            normals=None if made.normals is None else packed_normals(made.normals),
            layers={name: values[of_corner] for name, values in self.layers.items()},
            thickness=2.0 * float(self.radii.mean()),
        )


def finished(read: dict[Key, LocalMesh | Strands], places: dict[Key, int]) -> tuple[dict[Key, LocalMesh], list[str]]:
    """Meshes by key, strands as triangles, and a sentence if they are too many.

    places: number of placements of each.
    """
    strands = {key: each for key, each in read.items() if isinstance(each, Strands)}
    counts = [sum(each.triangle_count(detail) * places[key] for key, each in strands.items()) for detail in range(3)]
    detail = next((index for index, count in enumerate(counts) if count <= FINE_TRIANGLES), 2)
    share = min(1.0, MOST_TRIANGLES / max(counts[2], 1))
    notes = []
    if share < 1.0:
        names = named_list(sorted({each.name for each in strands.values()}))
        notes = [f"Of the hair and points of {names} {share:.0%} are voxelized, widened to cover as much: reduce them"]
    made = {key: each.thinned(share).mesh(detail) for key, each in strands.items()}
    return {key: made[key] if isinstance(each, Strands) else each for key, each in read.items()}, notes


def read_strands(item: bpy.types.Object, names: frozenset[str]) -> Strands | None:
    """Strands of an evaluated object of hair curves, or its points; None if there are none.

    names: attributes that materials read.
    """
    data, spheres = item.data, item.type == "POINTCLOUD"
    count = len(data.points)
    if count == 0:
        return None
    first = np.arange(count + 1) if spheres else values_of(data.curve_offset_data, "value", 1, np.int32).astype(int)
    lengths = np.diff(first)
    radii = _attribute(data, "radius", lengths)
    kinds = data.attributes.get("curve_type")
    # Cycles uses the type of the first strand; in Blender 5.3, attributes of this name may have other types.
    polylines = kinds is not None and kinds.data_type == "INT8" and kinds.data[0].value == _POLYLINE
    return _checked(
        Strands(
            item.name,
            values_of(data.attributes["position"].data, "vector", 3, np.float32).reshape(-1, 3),
            np.full(count, _RADII[item.type], np.float32) if radii is None else radii[:, 0],
            first,
            _first_uvs(data, lengths),
            {name: values for name in sorted(names) if (values := _attribute(data, name, lengths)) is not None},
            spheres=spheres,
            straight=not spheres and polylines and POLYLINES_ARE_STRAIGHT,
        )
    )


def _checked(strands: Strands) -> Strands | None:
    """Strands that Cycles shows: of at least two points, or spheres, all finite; none if all are damaged."""
    shown = np.diff(strands.first) >= (1 if strands.spheres else 2)
    valid = np.isfinite(strands.points).all(axis=1) & np.isfinite(strands.radii)
    damaged = np.diff(np.append(0, np.cumsum(~valid))[strands.first]) > 0
    if not shown.any():
        return None
    left = replace(strands.only(np.flatnonzero(shown & ~damaged)), damaged=bool((shown & damaged).any()))
    return left.divided().divided() if len(left) else left


def _attribute(data: bpy.types.ID, name: str, lengths: np.ndarray) -> np.ndarray | None:
    """Values (P, C) float32 of an attribute at the points."""
    attribute = data.attributes.get(name)
    if attribute is None or attribute.data_type not in ATTRIBUTE_KINDS:
        return None
    key, width, dtype = ATTRIBUTE_KINDS[attribute.data_type]
    values = values_of(attribute.data, key, width, dtype).reshape(-1, width).astype(np.float32)
    return np.repeat(values, lengths, axis=0) if attribute.domain == "CURVE" else values


def _first_uvs(data: bpy.types.ID, lengths: np.ndarray) -> np.ndarray | None:
    """(P, 2) float32 UV coordinates as in Cycles: the first ones of the strands."""
    for attribute in data.attributes:
        if attribute.domain == "CURVE" and attribute.data_type == "FLOAT2":
            return _attribute(data, attribute.name, lengths)
    return None


def hair_modifiers(item: bpy.types.Object) -> Iterator[bpy.types.ParticleSystemModifier]:
    """Particle modifiers of an object that render as strands."""
    for modifier in item.modifiers:
        if modifier.type == "PARTICLE_SYSTEM" and modifier.show_render:
            settings = modifier.particle_system.settings
            if settings.type == "HAIR" and settings.render_type == "PATH":
                yield modifier


def read_hair(
    item: bpy.types.Object, modifier: bpy.types.ParticleSystemModifier, names: frozenset[str]
) -> Strands | None:
    """Hair of a particle system of an evaluated object; only the children if there are any, as in Cycles.

    Reading takes 2 us per point. For names and None see `read_strands`.
    """
    system, settings = modifier.particle_system, modifier.particle_system.settings
    parents, children = len(system.particles), len(system.child_particles)
    begin = parents if settings.child_type != "NONE" and children else 0
    count = parents + children - begin
    rows = range(begin, parents + children, 1 + count // _MOST_READ)
    if not count:
        return None
    keys = (1 << settings.render_step) + 1 + (settings.kink_extra_steps if settings.kink == "SPIRAL" else 0)
    world = (system.co_hair(item, particle_no=row, step=step) for row in rows for step in range(keys))
    matrix = np.array(item.matrix_world.inverted_safe(), np.float64)
    points = np.fromiter(chain.from_iterable(world), np.float32).reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    points = points.astype(np.float32).reshape(-1, keys, 3)
    renders = next((layer.name for layer in item.data.uv_layers if layer.active_render), "")
    wanted = {name: name for name in sorted(names)} | {_UVS: renders}
    at_roots = {key: _emitter_uvs(item, modifier, rows, name) for key, name in wanted.items()}
    if GENERATED in names:
        at_roots[GENERATED] = generated_from_position(item.data, points[:, 0])
    layers = {name: np.repeat(values, keys, axis=0) for name, values in at_roots.items() if values is not None}
    return _checked(
        Strands(
            item.name,
            points.reshape(-1, 3),
            _radii_of_hair(settings, points).ravel() * np.float32(count / len(rows)),
            np.arange(len(rows) + 1) * keys,
            layers.pop(_UVS, None),
            layers,
            slot=min(max(settings.material - 1, 0), max(len(item.material_slots) - 1, 0)),
        )
    )


def _radii_of_hair(settings: bpy.types.ParticleSettings, points: np.ndarray) -> np.ndarray:
    """(S, K) float32 radii at the keys of strands (S, K, 3), by their lengths from the root."""
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2)
    along = np.concatenate([np.zeros((len(points), 1)), np.cumsum(steps, axis=1)], axis=1)
    left = 1.0 - along / np.maximum(along[:, -1:], 1e-30)
    shape = settings.shape
    left = np.clip(left, 0.0, 1.0) ** (1.0 + shape if shape < 0.0 else 1.0 / max(1.0 - shape, 1e-6))
    radii = 0.5 * settings.radius_scale * (settings.tip_radius + left * (settings.root_radius - settings.tip_radius))
    if settings.use_close_tip:
        radii[:, -1] = 0.0
    return radii.astype(np.float32)


def _emitter_uvs(
    item: bpy.types.Object, modifier: bpy.types.ParticleSystemModifier, rows: range, name: str
) -> np.ndarray | None:
    """(S, 2) float32: UV coordinates of the emitter at the roots of strands, by the name of their layer."""
    number = item.data.uv_layers.find(name)
    if number < 0:
        return None
    system = modifier.particle_system
    particles, read = system.particles, system.uv_on_emitter
    last = len(particles) - 1
    found = (read(modifier, particle=particles[min(row, last)], particle_no=row, uv_no=number) for row in rows)
    return np.fromiter(chain.from_iterable(found), np.float32).reshape(-1, 2)
