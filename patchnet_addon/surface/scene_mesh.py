# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface of a scene: each mesh once with its placements, streamed in batches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ..runtime.errors import GeometryError
from ..runtime.quantities import named_list
from .chroma import CHANNEL_WEIGHTS, CHANNELS
from .gloss import Gloss
from .local_mesh import LocalMesh
from .mesh import Material, Texture, TriangleBatch

BATCH_TRIANGLES = 250_000
# Receiver collections of an object by full name, and its state there: "INCLUDE" or "EXCLUDE".
Links = frozenset[tuple[str, str]]


@dataclass(frozen=True, eq=False)
class MeshInstances:
    """Mesh and its places.

    mesh: the triangles in their own space. objects: (P,) names of the placed objects.
    matrices_world: (P, 4, 4) float64. materials: (P, S) int32, index into the scene's materials for each slot.
    values: layer -> (P, C) float32, values of each object for its materials. links: (P,) int32, index into the scene's
    `light_links`.
    """

    mesh: LocalMesh
    objects: tuple[str, ...]
    matrices_world: np.ndarray
    materials: np.ndarray
    values: dict[str, np.ndarray]
    links: np.ndarray

    @property
    def mirrored(self) -> np.ndarray:
        """(P,) bool: the transform mirrors triangles, whose winding has to be reversed."""
        return np.linalg.det(self.matrices_world[:, :3, :3]) < 0

    @property
    def triangle_count(self) -> int:
        """Placed triangles."""
        return len(self.mesh) * len(self.objects)


@dataclass(frozen=True, eq=False)
class Run:
    """Triangles first to last of the instances lo to hi of one mesh; several instances only with all triangles."""

    instances: MeshInstances
    lo: int
    hi: int
    first: int
    last: int

    def __len__(self) -> int:
        return (self.hi - self.lo) * (self.last - self.first)

    @property
    def mirrored(self) -> np.ndarray:
        """(instances,) bool, see `MeshInstances.mirrored`."""
        return self.instances.mirrored[self.lo : self.hi]

    def corners_world(self) -> np.ndarray:
        """(N, 3, 3) float64, with the winding of Blender's normals also under mirroring transforms."""
        mesh, matrices = self.instances.mesh, self.instances.matrices_world[self.lo : self.hi]
        triangles = mesh.triangles[self.first : self.last]
        if self.first == 0 and self.last == len(mesh):
            points = mesh.vertices.astype(np.float64) @ matrices[:, :3, :3].transpose(0, 2, 1)  # (P, V, 3)
            corners = (points + matrices[:, None, :3, 3])[:, triangles]  # (P, T, 3, 3)
        else:
            corners = mesh.vertices[triangles].astype(np.float64).reshape(1, -1, 3)
            corners = corners @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]
        return self.wound(corners.reshape(self.hi - self.lo, -1, 3, 3))

    def per_corner(self, values: np.ndarray) -> np.ndarray:
        """Values (T, 3, C) of the mesh's corners for every triangle of the run: (N, 3, C), wound alike."""
        part = values[self.first : self.last]
        return self.wound(np.broadcast_to(part, (self.hi - self.lo, *part.shape)))

    def uvs(self, materials: tuple[Material, ...]) -> np.ndarray:
        """Texture coordinates (N, 3, 2) float32, of the UV map of each triangle's material; those not finite are 0."""
        mesh = self.instances.mesh
        uvs = np.zeros((len(self), 3, 2), np.float32) if mesh.uvs is None else self.per_corner(mesh.uvs)
        used = np.unique(self.instances.materials[self.lo : self.hi]).tolist()
        for name, channel in sorted({(materials[number].uv_map, materials[number].uv_channel) for number in used}):
            if name:
                uvs = uvs.copy()  # the array may be the mesh's own
                chosen = [(material.uv_map, material.uv_channel) == (name, channel) for material in materials]
                mine = np.array(chosen)[self.materials()]
                uvs[mine] = _coordinates(self._layer(name, 1 if channel == "A1" else 4), channel)[mine]
        uvs = np.nan_to_num(uvs, nan=0.0, posinf=0.0, neginf=0.0)
        for number in used:
            texture = materials[number].alpha_texture or materials[number].base_texture
            if texture is not None and texture.squares is not None:
                uvs = np.where((self.materials() == number)[:, None, None], _within_texels(uvs, texture), uvs)
        return uvs

    def _layer(self, name: str, width: int) -> np.ndarray:
        """Layer of the mesh, or values of the objects, at each corner (N, 3, C); `width` zeros if there are none."""
        mesh, values = self.instances.mesh, self.instances.values
        if name in mesh.layers:
            return self.per_corner(mesh.layers[name])
        own = values[name][self.lo : self.hi] if name in values else np.zeros((self.hi - self.lo, width), np.float32)
        return np.repeat(own, self.last - self.first, axis=0)[:, None].repeat(3, axis=1)

    def wound(self, values: np.ndarray) -> np.ndarray:
        """Values (P, T, 3, C) with corners 1 and 2 exchanged where the placement is mirrored, as (N, 3, C)."""
        mirrored = self.mirrored
        if mirrored.any():
            values = np.where(mirrored[:, None, None, None], values[:, :, [0, 2, 1]], values)
        return np.ascontiguousarray(values).reshape(-1, 3, values.shape[-1])

    def materials(self) -> np.ndarray:
        """(N,) int32 index into the scene's materials."""
        table = self.instances.materials[self.lo : self.hi]  # (P, S)
        slots = self.instances.mesh.slots
        count = self.last - self.first
        if slots is None:
            return np.repeat(table[:, 0], count)
        part = np.clip(slots[self.first : self.last], 0, table.shape[1] - 1)  # Blender clamps the slot too
        return table[:, part].reshape(-1)

    def normals_world(self) -> np.ndarray | None:
        """Shading normals (N, 3, 3) float32, unit length, or None if the mesh is flat."""
        normals = self.instances.mesh.corner_normals(self.first, self.last)
        if normals is None:
            return None
        linear = self.instances.matrices_world[self.lo : self.hi, :3, :3]
        # The cofactor matrix transforms normals also without an inverse; its sign follows mirroring.
        cofactors = np.stack([np.cross(linear[:, :, (i + 1) % 3], linear[:, :, (i + 2) % 3]) for i in range(3)], -1)
        cofactors = np.where(self.mirrored[:, None, None], -cofactors, cofactors)
        turned = normals.reshape(1, -1, 3).astype(np.float64) @ cofactors.transpose(0, 2, 1)
        turned /= np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-30)
        return self.wound(turned.astype(np.float32).reshape(self.hi - self.lo, -1, 3, 3))


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """`MeshSource` of a Blender scene; meshes are kept once; placed triangles exist only batch by batch.

    material_names: Blender's (full) name for each of `materials`, "" where a surface has none.
    warnings: sentences about missing or simplified input; color_warnings: those without effect on a bake.
    light_links: receiver collections of lamps that objects are in.
    gloss: of each of `materials`.
    """

    parts: tuple[MeshInstances, ...]
    materials: tuple[Material, ...]
    material_names: tuple[str, ...]
    warnings: list[str]
    light_links: tuple[Links, ...]
    gloss: tuple[Gloss, ...] = ()
    color_warnings: tuple[str, ...] = ()
    boxes_world: np.ndarray = field(init=False)  # (P, 2, 3) float64 of each placed mesh
    bounds_world: np.ndarray = field(init=False)  # (2, 3) float64
    triangle_count: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "triangle_count", sum(part.triangle_count for part in self.parts))
        boxes = np.array([box for part in self.parts for box in _boxes(part)])
        object.__setattr__(self, "boxes_world", boxes)
        object.__setattr__(self, "bounds_world", np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)]))
        if not any(_has_area(batch.corners_world) for batch in self.batches()):
            shown = named_list(sorted(set(self.object_names)))
            raise GeometryError(f"The surface of {shown} has no area: choose objects whose faces are not degenerate")

    @property
    def turned_materials(self) -> frozenset[str]:
        """Names of materials on objects that are turned or scaled."""
        used: set[int] = set()
        for part in self.parts:
            turned = ~np.isclose(part.matrices_world[:, :3, :3], np.eye(3), atol=1e-5).all(axis=(1, 2))
            used.update(np.unique(part.materials[turned]).tolist())
        return frozenset(self.material_names[index] for index in used)

    def objects_of(self, triangles: np.ndarray) -> np.ndarray:
        """(N,) names of the objects of triangles (N,)."""
        ends = np.cumsum(np.concatenate([np.full(len(part.objects), len(part.mesh)) for part in self.parts]))
        return np.array(self.object_names, object)[np.searchsorted(ends, triangles, side="right")]

    @property
    def object_names(self) -> list[str]:
        """Name of each placed object."""
        return [name for part in self.parts for name in part.objects]

    def batches(self) -> Iterator[TriangleBatch]:
        """Triangles in batches, all in a fixed order: mesh by mesh, placement by placement."""
        first = 0
        for runs in self.runs():
            batch = _batch(runs, first, self.materials)
            yield batch
            first += len(batch)

    def runs(self) -> Iterator[tuple[Run, ...]]:
        """Runs of each of the `batches`: large meshes are divided, small ones grouped."""
        group: list[Run] = []
        count = 0
        for part in self.parts:
            for run in _runs(part):
                if group and count + len(run) > BATCH_TRIANGLES:
                    yield tuple(group)
                    group, count = [], 0
                group.append(run)
                count += len(run)
        if group:
            yield tuple(group)


def _within_texels(uvs: np.ndarray, texture: Texture) -> np.ndarray:
    """UVs (N, 3, 2), of triangles that lie on one point of square texels the centre of the texel that Cycles takes."""
    matrix = np.array(texture.transform or np.eye(2, 3))
    point = (uvs == uvs[:, :1]).all(axis=(1, 2))
    if not point.any() or not np.linalg.det(matrix[:, :2]):
        return uvs
    at = (uvs[point, 0] @ matrix[:, :2].T + matrix[:, 2]) * texture.squares
    centre = (np.floor(at) + 0.5) / texture.squares - matrix[:, 2]
    uvs = uvs.copy()
    uvs[point] = (centre @ np.linalg.inv(matrix[:, :2]).T)[:, None]
    return uvs


def with_opacities(material: Material, number: int, parts: Sequence[MeshInstances]) -> Material:
    """Replace the texels of an opacity from a layer by the opacities that meshes with the material have."""
    texture, name = material.alpha_texture, material.uv_map
    if texture is None or not material.uv_channel:
        return material
    used = [part for part in parts if (part.materials == number).any()]
    layers = [part.mesh.layers[name] for part in used if name in part.mesh.layers]
    layers += [part.values[name][:, None] for part in used if name in part.values]
    values = [_coordinates(layer, material.uv_channel).ravel() for layer in layers] or [np.zeros(1, np.float32)]
    ramp = texture.pixels[0, :, 0]
    found = np.interp(np.concatenate(values), np.linspace(0.0, 1.0, len(ramp)), ramp)
    return replace(material, alpha_texture=replace(texture, pixels=found.reshape(1, -1, 1)))


def _coordinates(values: np.ndarray, channel: str) -> np.ndarray:
    """Texture coordinates (N, 3, 2 or 1) of a layer's values (N, 3, C): the first two, or the number of a channel."""
    if not channel:
        return values[..., :2]
    if channel in ("A", "A1"):
        return values[..., 3:] if values.shape[-1] == 4 else np.ones_like(values[..., :1])
    if values.shape[-1] == 1:
        return values
    colors = values[..., :3]
    weights = CHANNEL_WEIGHTS.get(channel, np.eye(3, dtype=np.float32)[CHANNELS.get(channel, 0)])
    return (colors @ weights[: colors.shape[-1]])[..., None]


def _runs(part: MeshInstances) -> Iterator[Run]:
    """Runs of at most BATCH_TRIANGLES triangles that cover all instances of a mesh."""
    size = len(part.mesh)
    together = max(1, BATCH_TRIANGLES // size)
    for lo in range(0, len(part.objects), together):
        hi = min(lo + together, len(part.objects))
        pieces = max(1, -(-size // BATCH_TRIANGLES))
        cuts = np.linspace(0, size, pieces + 1).astype(int)
        for first, last in pairwise(cuts):
            yield Run(part, lo, hi, int(first), int(last))


def _batch(runs: tuple[Run, ...], first_triangle: int, materials: tuple[Material, ...]) -> TriangleBatch:
    names = dict.fromkeys(name for run in runs for name in run.instances.objects[run.lo : run.hi])
    return TriangleBatch(
        corners_world=np.concatenate([run.corners_world() for run in runs]),
        uvs=np.concatenate([run.uvs(materials) for run in runs]),
        materials=np.concatenate([run.materials() for run in runs]).astype(np.int32),
        first_triangle=first_triangle,
        name=next(iter(names)) if len(names) == 1 else "",
    )


def _boxes(part: MeshInstances) -> Iterator[np.ndarray]:
    """(2, 3) float64 of each placed mesh."""
    vertices = np.ascontiguousarray(part.mesh.vertices.T, np.float64)  # sums over rows are several times faster
    for matrix in part.matrices_world:
        points = matrix[:3, :3] @ vertices + matrix[:3, 3:]
        yield np.stack([points.min(axis=1), points.max(axis=1)])


def _has_area(corners_world: np.ndarray) -> bool:
    edges = corners_world[:, 1:] - corners_world[:, :1]
    return bool(np.cross(edges[:, 0], edges[:, 1]).any())
