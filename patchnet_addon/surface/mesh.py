# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh source: triangles for the voxelizer, in batches with material ids, so that memory is bounded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from ..runtime.errors import GeometryError

AXES = ("x", "y", "z")
MIN_OPACITY = 1.0 / 255.0  # of a fragment: below it, it leaves no trace
_NO_KEYS = np.empty(0, np.uint64)
_NO_CORNERS = np.empty((0, 3, 3), np.float64)


@dataclass(frozen=True, eq=False)
class Texture:
    """Image in linear Rec. 709 (colour) or raw values (alpha).

    pixels: (H, W, C) float32, row 0 at v = 0, C = 1 (alpha) or 3 (colour).
    wrap: what is outside the image: "REPEAT", "EXTEND", "MIRROR" or "CLIP" (nothing), as Blender names them.
    transform: image coordinates are this (2, 3) matrix times (u, v, 1); None for (u, v) themselves.
    squares: columns and rows of texels that are squares of one colour; None for bilinear interpolation.
    """

    name: str
    pixels: np.ndarray
    wrap: str = "REPEAT"
    transform: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    squares: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class Material:
    """View-independent part of a material; base_color and emission are linear Rec. 709."""

    name: str
    base_color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    base_texture: Texture | None = None  # multiplied with base_color
    alpha: float = 1.0
    alpha_texture: Texture | None = None  # multiplied with alpha
    alpha_threshold: float | None = None  # opacity becomes 0 or 1 at this value; None: partial opacity
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    glows: bool = False  # it reflects nothing: base_color and base_texture are its emission, of which that is the mean
    uv_map: str = ""  # that its textures lie on; "" is the one that renders
    # Both coordinates are this number of the map: "R", "G", "B", "A", "Y", "MEAN", or "A1", which is 1 without a map.
    uv_channel: str = ""
    clear_side: int | None = None  # see-through side, 0 the front and 1 the back, to rays that end on the surface
    base_is_known: bool = True  # base colour and its texture are all that a renderer reads


class TriangleArrays(NamedTuple):
    """Triangles of a batch in the form of kernels; shapes as in `TriangleBatch`."""

    corners_world: np.ndarray
    uvs: np.ndarray
    materials: np.ndarray


@dataclass(frozen=True, eq=False)
class TriangleBatch:
    """Triangles of one placed object.

    corners_world: (T, 3, 3) float64, triangle, corner, axis.
    uvs: (T, 3, 2) float32, of the UV map of each triangle's material; zeros where the mesh has none.
    materials: (T,) int32 into the source's `materials`.
    first_triangle: index of the batch's first triangle among all triangles of the source, in its fixed order.
    """

    corners_world: np.ndarray
    uvs: np.ndarray
    materials: np.ndarray
    first_triangle: int
    name: str = ""

    def __len__(self) -> int:
        return len(self.corners_world)

    @property
    def arrays(self) -> TriangleArrays:
        """Triangles for kernels."""
        return TriangleArrays(self.corners_world, self.uvs, self.materials)


class MeshSource(Protocol):
    """Surface that can be read batch by batch, any number of times, always in the same order."""

    @property
    def materials(self) -> tuple[Material, ...]:
        """Materials that batches refer to."""

    @property
    def bounds_world(self) -> np.ndarray:
        """(2, 3) float64, lowest and highest corner."""

    @property
    def triangle_count(self) -> int:
        """Triangles of all batches."""

    def batches(self) -> Iterator[TriangleBatch]:
        """Batches of all triangles."""


class FragmentArrays(NamedTuple):
    """Fragments in the form of kernels; shapes as in `Fragments`, but (0,) and (0, 3, 3) without outlines."""

    keys: np.ndarray
    triangle: np.ndarray
    barycentric: np.ndarray
    area_world: np.ndarray
    cut_keys: np.ndarray
    corners_voxel: np.ndarray


@dataclass(frozen=True, eq=False)
class Fragments:
    """Pieces of the triangles of one batch, each inside one leaf cell (methods 7.2).

    keys: (F,) uint64 Morton keys of the cells. triangle: (F,) int32 in the batch.
    barycentric: (F, 2) float32, weights of corners 1 and 2 at the piece's centroid.
    area_world: (F,) float64.
    cut_keys: (F,) uint64 cells that the pieces were cut out of, and corners_voxel: (T, 3, 3) float64, the batch's
    triangles in units of these cells: together the outline of each piece. None where only the centroids are known.
    boxes: (F,) uint32 around the pieces, packed (`cells/leaf_boxes.py`); None where they are not known.
    level: of the cells, -1 where it is not known. surface: luminance of the base colour and opacity (F,) float32 each,
    once they were looked up (`surface_of_fragments`).
    """

    keys: np.ndarray
    triangle: np.ndarray
    barycentric: np.ndarray
    area_world: np.ndarray
    cut_keys: np.ndarray | None = None
    corners_voxel: np.ndarray | None = None
    boxes: np.ndarray | None = None
    level: int = -1
    surface: tuple[np.ndarray, np.ndarray] | None = None

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def arrays(self) -> FragmentArrays:
        """Fragments for kernels."""
        outlines = (_NO_KEYS, _NO_CORNERS)
        if self.cut_keys is not None and self.corners_voxel is not None:
            outlines = (self.cut_keys, self.corners_voxel)
        return FragmentArrays(self.keys, self.triangle, self.barycentric, self.area_world, *outlines)

    def only(self, chosen: np.ndarray) -> Fragments:
        """Select fragments at indices (n,)."""
        return Fragments(
            self.keys[chosen],
            self.triangle[chosen],
            self.barycentric[chosen],
            self.area_world[chosen],
            None if self.cut_keys is None else self.cut_keys[chosen],
            self.corners_voxel,
            None if self.boxes is None else self.boxes[chosen],
            self.level,
            None if self.surface is None else (self.surface[0][chosen], self.surface[1][chosen]),
        )


class Shading(NamedTuple):
    """What lights F fragments of a batch of T triangles.

    luminance: (F,) float32, linear before exposure. opacity: (F,) float32 in [0, 1]. color: (F, 3) float32, linear, of
    which only the hue counts: it is brought to that luminance; (0, 3) without colour. sides: (F, 2, 1) float32
    luminance of front and back, or (F, 2, 4) with colour, where both have light of their own; else (0, 2, 1). lit: (T,)
    int8, lit sides of the triangles (`sides.py`); (0,) if all have light on the front alone.
    """

    luminance: np.ndarray
    opacity: np.ndarray
    color: np.ndarray = np.empty((0, 3), np.float32)
    sides: np.ndarray = np.empty((0, 2, 1), np.float32)
    lit: np.ndarray = np.empty(0, np.int8)

    @property
    def arrays(self) -> Shading:
        """The same for kernels: contiguous arrays of these types."""
        light = [np.ascontiguousarray(values, np.float32) for values in self[:4]]
        return Shading(*light)._replace(lit=np.ascontiguousarray(self.lit, np.int8))

    @property
    def lights(self) -> np.ndarray:
        """Luminance, and colour, (F, 2, 1 or 4) float32 of front and back, or (F, 1, 1 or 4) if both have one light."""
        if len(self.sides):
            return np.asarray(self.sides, np.float32)
        hue = self.color if len(self.color) else np.empty((len(self.luminance), 0), np.float32)
        return np.concatenate([self.luminance[:, None], hue], axis=1, dtype=np.float32)[:, None]


ShadingFn = Callable[[TriangleBatch, Fragments], Shading]
"""Light of the fragments of a batch; called in threads."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Mesh in memory as a `MeshSource`: one batch, or several."""

    parts: tuple[TriangleBatch, ...]
    materials: tuple[Material, ...] = (Material("default"),)
    bounds_world: np.ndarray = field(init=False)
    triangle_count: int = field(init=False)

    def __post_init__(self) -> None:
        corners = [part.corners_world.reshape(-1, 3) for part in self.parts if len(part)]
        if not corners:
            raise GeometryError("The mesh has no triangles: choose objects that have a surface")
        low = np.min([points.min(axis=0) for points in corners], axis=0)
        high = np.max([points.max(axis=0) for points in corners], axis=0)
        object.__setattr__(self, "bounds_world", np.stack([low, high]).astype(np.float64))
        object.__setattr__(self, "triangle_count", sum(len(part) for part in self.parts))

    @classmethod
    def from_arrays(cls, corners_world: np.ndarray, materials: tuple[Material, ...] | None = None) -> TriangleMesh:
        """Mesh from triangle corners (T, 3, 3), all of the first material and without texture coordinates."""
        corners = np.ascontiguousarray(corners_world, np.float64)
        count = len(corners)
        batch = TriangleBatch(corners, np.zeros((count, 3, 2), np.float32), np.zeros(count, np.int32), 0)
        return cls((batch,), materials or (Material("default"),))

    def batches(self) -> Iterator[TriangleBatch]:
        """Parts, in order."""
        return iter(self.parts)


def random_rotation(seed: int) -> np.ndarray:
    """Rotation (3, 3) drawn uniformly: the orthogonal factor of a Gaussian matrix, made proper."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


class RotatedSource:
    """`MeshSource` whose triangles are those of another one, rotated about the origin by a matrix (3, 3)."""

    def __init__(self, source: MeshSource, rotation: np.ndarray) -> None:
        self._source = source
        self._rotation = np.asarray(rotation, np.float64)
        self.materials: tuple[Material, ...] = source.materials
        self.triangle_count: int = source.triangle_count
        low = np.full(3, np.inf)
        high = np.full(3, -np.inf)
        for batch in self.batches():
            points = batch.corners_world.reshape(-1, 3)
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        self.bounds_world: np.ndarray = np.stack([low, high])

    def batches(self) -> Iterator[TriangleBatch]:
        """Source's batches, rotated."""
        for batch in self._source.batches():
            yield replace(batch, corners_world=batch.corners_world @ self._rotation.T)
