# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair and points as triangles: hair curves, particle hair and point clouds, which have no mesh.

Cycles renders a strand as a ribbon that faces each ray, or as a round tube, and a point as a sphere. Tubes and spheres
of flat sides cover as much as those do, seen from all around: the mean shadow of a convex body is a quarter of its
surface. They need not enclose the strand: no ray meets a ribbon, tube or sphere of Cycles from inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import GeometryError
from ..state.digest import values_of
from .layer_names import GENERATED
from .local_mesh import ATTRIBUTE_KINDS, LocalMesh, generated_from_position

STRANDS = frozenset({"CURVES", "POINTCLOUD"})  # types of objects
FINE_TRIANGLES, MOST_TRIANGLES = 200_000, 1_000_000  # of all strands and points of a scene
_RADII = {"CURVES": 0.005, "POINTCLOUD": 0.01}  # what Cycles takes without an attribute
_SIDES = (7, 5, 3)  # of tubes, by detail; odd numbers, whose mean light depends least on where a side faces
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))  # that each tube is turned by against the one before
_MOST_READ = 500_000  # strands of a particle system; Blender tells the points of particle hair one by one


@dataclass(frozen=True, eq=False)
class Strands:
    """Strands, or points, of one object in its own space.

    points: (P, 3) float32. radii: (P,) float32. first: (S + 1,) int64, strand s has points first[s] to first[s + 1].
    slots: (S,) int16 material slots. uvs: (P, 2) float32 or None. layers: (P, C) float32, see `LocalMesh`.
    spheres: each point is a sphere, and a strand of its own.
    """

    name: str
    points: np.ndarray
    radii: np.ndarray
    first: np.ndarray
    slots: np.ndarray
    uvs: np.ndarray | None = None
    layers: dict[str, np.ndarray] = field(default_factory=dict)
    spheres: bool = False

    def triangle_count(self, detail: int) -> int:
        """Triangles of `mesh`."""
        if self.spheres:
            return len(self.points) * len(_solid(detail)[1])
        strands, sides = len(self.first) - 1, _SIDES[detail]
        return 2 * sides * (len(self.points) - strands) + 2 * (sides - 2) * strands

    def only(self, chosen: np.ndarray, width: float = 1.0) -> Strands:
        """Strands `chosen` (N,) by number, their radii times `width`."""
        lengths = np.diff(self.first)[chosen]
        first = np.concatenate([[0], np.cumsum(lengths)])
        rows = np.repeat(self.first[chosen] - first[:-1], lengths) + np.arange(first[-1])
        uvs = None if self.uvs is None else self.uvs[rows]
        layers = {name: values[rows] for name, values in self.layers.items()}
        radii = self.radii[rows] * np.float32(width)
        return Strands(self.name, self.points[rows], radii, first, self.slots[chosen], uvs, layers, self.spheres)

    def thinned(self, share: float) -> Strands:
        """A share of the strands, evenly chosen and so wide that they cover as much."""
        count = len(self.first) - 1
        kept = max(1, round(count * share))
        if kept >= count:
            return self
        width = (count / kept) ** (0.5 if self.spheres else 1.0)
        return self.only(np.arange(kept) * count // kept, width)

    def mesh(self, detail: int) -> LocalMesh:
        """Closed tubes or spheres; `detail` 0 has most triangles, 2 fewest."""
        build = _spheres if self.spheres else _tubes
        vertices, triangles, points, strands, normals = build(self, detail)
        of_corner = points[triangles]
        slots = self.slots[strands]
        return LocalMesh(
            name=self.name,
            vertices=vertices.astype(np.float32),
            triangles=triangles.astype(np.int32),
            uvs=None if self.uvs is None else self.uvs[of_corner],
            slots=slots if slots.any() else None,
            normals=normals,
            layers={name: values[of_corner] for name, values in self.layers.items()},
        )


def finished(read: Mapping[object, LocalMesh | Strands], places: Mapping[object, int]) -> tuple[dict, list[str]]:
    """Meshes by key, strands as triangles, and a sentence if they are too many.

    places: how often each is placed.
    """
    strands = {key: each for key, each in read.items() if isinstance(each, Strands)}
    counts = [sum(each.triangle_count(detail) * places[key] for key, each in strands.items()) for detail in range(3)]
    detail = next((index for index, count in enumerate(counts) if count <= FINE_TRIANGLES), 2)
    share = min(1.0, MOST_TRIANGLES / max(counts[2], 1))
    notes = []
    if share < 1.0:
        names = named(sorted({each.name for each in strands.values()}))
        notes = [f"Of the hair and points of {names} {share:.0%} are voxelized, widened to cover as much: reduce them"]
    return read | {key: each.thinned(share).mesh(detail) for key, each in strands.items()}, notes


def named(names: list[str]) -> str:
    """Names in quotation marks, not all of very many."""
    return ", ".join(f"'{name}'" for name in names[:3]) + (" and others" if len(names) > 3 else "")


def read_strands(item: bpy.types.Object, names: frozenset[str]) -> Strands | None:
    """Strands of an evaluated object of hair curves, or its points; None if there are none.

    names: attributes that materials ask for. Raises GeometryError if a coordinate is not finite.
    """
    data, spheres = item.data, item.type == "POINTCLOUD"
    count = len(data.points)
    if count == 0:
        return None
    first = np.arange(count + 1) if spheres else values_of(data.curve_offset_data, "value", 1, np.int32).astype(int)
    lengths = np.diff(first)
    radii = _attribute(data, "radius", lengths)
    strands = Strands(
        item.name,
        values_of(data.attributes["position"].data, "vector", 3, np.float32).reshape(-1, 3),
        np.full(count, _RADII[item.type], np.float32) if radii is None else radii[:, 0],
        first,
        np.zeros(len(lengths), np.int16),
        _first_uvs(data, lengths),
        {name: values for name in sorted(names) if (values := _attribute(data, name, lengths)) is not None},
        spheres,
    )
    return _checked(strands)


def _checked(strands: Strands) -> Strands | None:
    """Those that Cycles shows: of two points at least, or a sphere."""
    if not (np.isfinite(strands.points).all() and np.isfinite(strands.radii).all()):
        raise GeometryError(
            f"Hair or points of object '{strands.name}' are not finite numbers (NaN or infinite): repair or remove them"
        )
    shown = np.flatnonzero(np.diff(strands.first) >= (1 if strands.spheres else 2))
    return strands.only(shown) if len(shown) else None


def _attribute(data: bpy.types.ID, name: str, lengths: np.ndarray) -> np.ndarray | None:
    """Values (P, C) float32 of an attribute at the points."""
    attribute = data.attributes.get(name)
    if attribute is None or attribute.data_type not in ATTRIBUTE_KINDS:
        return None
    key, width = ATTRIBUTE_KINDS[attribute.data_type]
    values = values_of(attribute.data, key, width, np.float32).reshape(-1, width)
    return np.repeat(values, lengths, axis=0) if attribute.domain == "CURVE" else values


def _first_uvs(data: bpy.types.ID, lengths: np.ndarray) -> np.ndarray | None:
    """(P, 2) float32: what Cycles takes for UV coordinates, the first ones of the strands."""
    for attribute in data.attributes:
        if attribute.domain == "CURVE" and attribute.data_type == "FLOAT2":
            return _attribute(data, attribute.name, lengths)
    return None


def has_hair(item: bpy.types.Object) -> bool:
    """Return whether an evaluated object has particles that renders show as strands."""
    return next(_hair_modifiers(item), None) is not None


def _hair_modifiers(item: bpy.types.Object) -> Iterator[bpy.types.ParticleSystemModifier]:
    for modifier in item.modifiers:
        if modifier.type == "PARTICLE_SYSTEM" and modifier.show_render:
            settings = modifier.particle_system.settings
            if settings.type == "HAIR" and settings.render_type == "PATH":
                yield modifier


def read_hair(item: bpy.types.Object, names: frozenset[str]) -> Strands | None:
    """Particle hair of an evaluated object, all its systems; see `read_strands`. 2 us for each of its points."""
    parts = [part for modifier in _hair_modifiers(item) if (part := _hair_of(item, modifier, names)) is not None]
    if not parts:
        return None
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    ends = [part.first[1:] + start for part, start in zip(parts, starts[:-1], strict=True)]
    uvs = [part.uvs for part in parts if part.uvs is not None]
    strands = Strands(
        item.name,
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.radii for part in parts]),
        np.concatenate([[0], *ends]),
        np.concatenate([part.slots for part in parts]),
        np.concatenate(uvs) if uvs else None,
        {name: np.concatenate([part.layers[name] for part in parts]) for name in parts[0].layers},
    )
    return _checked(strands)


def _hair_of(
    item: bpy.types.Object, modifier: bpy.types.ParticleSystemModifier, names: frozenset[str]
) -> Strands | None:
    """Hair of one particle system; of one with children, these alone, as Cycles does."""
    system, settings = modifier.particle_system, modifier.particle_system.settings
    parents, children = len(system.particles), len(system.child_particles)
    begin = parents if settings.child_type != "NONE" and children else 0
    rows = range(begin, parents + children, 1 + (parents + children - begin) // _MOST_READ)
    keys = (1 << settings.render_step) + 1 + (settings.kink_extra_steps if settings.kink == "SPIRAL" else 0)
    if not len(rows):
        return None
    read, steps = system.co_hair, range(keys)
    world = np.fromiter(
        chain.from_iterable(read(item, particle_no=row, step=step) for row in rows for step in steps), np.float32
    )
    matrix = np.array(item.matrix_world.inverted_safe(), np.float64)
    points = (world.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]).reshape(len(rows), keys, 3)
    radii = _radii_of_hair(settings, points) * np.float32((parents + children - begin) / len(rows))
    layers = {name: values for name in sorted(names) if (values := _of_emitter(item, modifier, rows, name)) is not None}
    if GENERATED in names:
        layers[GENERATED] = generated_from_position(item.data, points[:, 0].astype(np.float32))
    uv_layer = next((layer.name for layer in item.data.uv_layers if layer.active_render), "")
    uvs = _of_emitter(item, modifier, rows, uv_layer)
    slot = min(max(settings.material - 1, 0), max(len(item.material_slots) - 1, 0))
    return Strands(
        item.name,
        points.reshape(-1, 3).astype(np.float32),
        radii.ravel(),
        np.arange(len(rows) + 1) * keys,
        np.full(len(rows), slot, np.int16),
        None if uvs is None else np.repeat(uvs, keys, axis=0),
        {name: np.repeat(values, keys, axis=0) for name, values in layers.items()},
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


def _of_emitter(
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


_Built = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]


def _tubes(strands: Strands, detail: int) -> _Built:
    """Vertices, triangles, point of each vertex, strand of each triangle, and normals: tubes with flat ends."""
    sides, count = _SIDES[detail], len(strands.points)
    of_point = np.repeat(np.arange(len(strands.first) - 1), np.diff(strands.first))
    angles = 2.0 * np.pi * np.arange(sides) / sides + of_point[:, None] * _GOLDEN_ANGLE
    u, v = _frames(strands)
    around = u[:, None] * np.cos(angles)[..., None] + v[:, None] * np.sin(angles)[..., None]
    radii = strands.radii.clip(0.0) * np.pi / (sides * np.sin(np.pi / sides))
    vertices = (strands.points[:, None] + around * radii[:, None, None]).reshape(-1, 3)
    side, ring = np.arange(sides), np.arange(count)[:, None] * sides
    a, b = ring + side, ring + (side + 1) % sides
    quads = np.stack([a, b, b + sides, a, b + sides, a + sides], axis=-1)
    starts = np.delete(np.arange(count), strands.first[1:] - 1)
    walls = quads[starts].reshape(-1, 3)
    fan = np.stack([np.zeros(sides - 2, int), side[1:-1], side[2:]], axis=-1)
    tips = ring[strands.first[1:] - 1][:, None] + fan
    roots = ring[strands.first[:-1]][:, None] + fan[:, [0, 2, 1]]
    triangles = np.concatenate([walls, tips.reshape(-1, 3), roots.reshape(-1, 3)])
    ends = np.tile(np.repeat(np.arange(len(strands.first) - 1), sides - 2), 2)
    owners = np.concatenate([np.repeat(of_point[starts], 2 * sides), ends])
    return vertices, triangles, np.repeat(np.arange(count), sides), owners, None


def _frames(strands: Strands) -> tuple[np.ndarray, np.ndarray]:
    """Two directions (P, 3) across each point's strand, which twist as little as they can along it."""
    starts = np.delete(np.arange(len(strands.points)), strands.first[1:] - 1)
    along = _unit(strands.points[starts + 1].astype(np.float64) - strands.points[starts])
    tangents = np.zeros((len(strands.points), 3))
    tangents[starts] += along
    tangents[starts + 1] += along
    tangents = _unit(tangents)
    axes = np.eye(3)[np.abs(tangents).argmin(axis=1)]
    u = _unit(np.cross(tangents, axes))
    lengths = np.diff(strands.first)
    for step in range(1, lengths.max()):
        at = strands.first[:-1][lengths > step] + step
        turned = u[at - 1] - tangents[at] * (u[at - 1] * tangents[at]).sum(axis=1, keepdims=True)
        follows = (turned**2).sum(axis=1) > 1e-6
        u[at[follows]] = _unit(turned[follows])
    return u, np.cross(tangents, u)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Of length 1; along z where there is no length."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(lengths > 0.0, vectors / np.where(lengths > 0.0, lengths, 1.0), [0.0, 0.0, 1.0])


def _spheres(strands: Strands, detail: int) -> _Built:
    """As `_tubes`: a solid at each point, with the normals of a sphere."""
    solid, faces = _solid(detail)
    corners = solid[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0
    radii, count = strands.radii.clip(0.0) * np.sqrt(4.0 * np.pi / area), len(strands.points)
    vertices = (strands.points[:, None] + solid * radii[:, None, None]).reshape(-1, 3)
    triangles = (faces + np.arange(count)[:, None, None] * len(solid)).reshape(-1, 3)
    normals = np.tile(np.rint(corners * 32767.0).astype(np.int16), (count, 1, 1))
    return vertices, triangles, np.repeat(np.arange(count), len(solid)), np.repeat(np.arange(count), len(faces)), normals


def _solid(detail: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) of length 1 and faces (F, 3): an octahedron, its faces divided once or twice."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])
    for _ in range(2 - detail):
        corners = vertices[faces]
        middles = _unit(corners + np.roll(corners, -1, axis=1))  # of edges 01, 12, 20
        a, b, c = np.arange(3 * len(faces)).reshape(-1, 3).T
        first = 3 * len(faces)
        d, e, f = a + first, b + first, c + first
        vertices = np.concatenate([corners.reshape(-1, 3), middles.reshape(-1, 3)])
        faces = np.stack([a, d, f, d, b, e, f, e, c, d, e, f], axis=-1).reshape(-1, 3)
    return vertices, faces
