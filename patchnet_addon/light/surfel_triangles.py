# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfels as small triangles, with a block of texels for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..surface.scene_mesh import Run, SceneMesh
from ..surface.sides import BACK
from ..surface.triangles import triangle_areas_and_normals

# A surfel has a block of texels of its own. Its triangle there owns the PARTS lowest ones, and touches no other block.
BLOCK, PARTS = 2, 2
_IN_BLOCK = np.array([[0.05, 0.05], [1.95, 0.05], [1.0, 1.45]])
_EQUILATERAL = 3.0 * 3.0**0.5 / 4.0  # area of an equilateral triangle over its squared circumradius
_LEAST_SHARE = 1e-6  # of a triangle's area: Cycles bakes nothing on slivers that a voxel cuts off
_LEAST_COSINE = 0.05  # of shading normals to the front, which a bake looks at along them
_LEAST_WEIGHT = 1e-4  # of a corner in a corner of a surfel: it stays within its triangle
_COLUMNS = ("number", "corners_world", "normals_world", "uvs", "texel_uvs", "materials", "links", "is_back", "open")


@dataclass(frozen=True, eq=False)
class SurfelTriangles:
    """Triangles of N surfels, with the lit side as their front.

    number: (N,) int64, the surfel's place among those of the call. corners_world: (N, 3, 3) float64. normals_world:
    (N, 3, 3) float32. uvs: (N, 3, 2) float32. texel_uvs: (N, 3, 2) float32, on the image. materials: (N,) int32.
    links: (N,) int32, index into the source's `light_links`. is_back: (N,) bool, the back is lit. open: (N,) float32,
    share of the light on normals_world that reaches shading normals which point below the surface. layers: corner
    layers by name, (N, 3, C) float32.
    """

    number: np.ndarray
    corners_world: np.ndarray
    normals_world: np.ndarray
    uvs: np.ndarray
    texel_uvs: np.ndarray
    materials: np.ndarray
    links: np.ndarray
    is_back: np.ndarray
    open: np.ndarray
    layers: dict[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.number)

    def only(self, chosen: np.ndarray) -> SurfelTriangles:
        """Select the triangles where `chosen` (N,) is true."""
        return SurfelTriangles(
            **{name: getattr(self, name)[chosen] for name in _COLUMNS},
            layers={name: values[chosen] for name, values in self.layers.items()},
        )


def joined(parts: Sequence[SurfelTriangles]) -> SurfelTriangles:
    """Triangles of all parts; missing layers are zero, narrower ones are widened."""
    widths: dict[str, int] = {}
    for part in parts:
        for name, values in part.layers.items():
            widths[name] = max(widths.get(name, 0), values.shape[-1])
    layers = {
        name: np.concatenate([_widened(part.layers.get(name), (len(part), 3, width)) for part in parts])
        for name, width in widths.items()
    }
    return SurfelTriangles(
        **{name: np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMNS}, layers=layers
    )


def _widened(values: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Layer of shape (N, 3, C) from one with fewer numbers, as shaders read it: a number is gray, alpha is 1."""
    wanted = shape[-1]
    if values is not None and values.shape[-1] == wanted:
        return values
    wide = np.zeros(shape, np.float32)
    wide[..., 3:] = 1.0
    if values is not None:
        width = values.shape[-1]
        wide[..., : min(wanted, 3) if width == 1 else width] = values
    return wide


def surfel_triangles(
    source: SceneMesh, surfels: np.ndarray, size: tuple[int, int], coordinates: str
) -> SurfelTriangles:
    """Triangles of surfels (N,) SURFEL on an image of a width and height, block by block, row by row.

    coordinates: name of a layer for object coordinates; "" for none.
    """
    order = np.argsort(surfels["triangle"], kind="stable")
    triangles = surfels["triangle"][order]
    parts: list[SurfelTriangles] = []
    first = 0
    for run in (run for runs in source.runs() for run in runs):
        low, high = np.searchsorted(triangles, [first, first + len(run)])
        if low < high:
            mine = order[low:high]
            parts.append(_part(run, triangles[low:high] - first, mine, surfels[mine], size, coordinates))
        first += len(run)
    return joined(parts)


def _part(
    run: Run, local: np.ndarray, number: np.ndarray, surfels: np.ndarray, size: tuple[int, int], coordinates: str
) -> SurfelTriangles:
    """Triangles of surfels on the triangles `local` (N,) of a run."""
    corners, mesh = run.corners_world()[local], run.instances.mesh
    weights, is_back = _weights(corners, surfels), surfels["side"] == BACK
    weights[is_back] = weights[is_back][:, [0, 2, 1]]

    def mean(values: np.ndarray) -> np.ndarray:
        return np.einsum("nkc,ncx->nkx", weights, values[local])

    normals = run.normals_world()
    flat = np.repeat(triangle_areas_and_normals(corners)[1][:, None], 3, axis=1)
    turned, opened = flat, np.ones(len(local), np.float32)
    if normals is not None:
        turned, opened = _in_front(mean(normals), flat)
    turned = np.where(is_back[:, None, None], -turned, turned)
    layers = {name: mean(run.per_corner(values)).astype(np.float32) for name, values in mesh.layers.items()}
    for name, values in run.instances.values.items():
        of_triangle = values[run.lo + local // (run.last - run.first)]
        layers[name] = np.repeat(of_triangle[:, None], 3, axis=1)
    if coordinates:
        layers[coordinates] = mean(run.per_corner(mesh.vertices[mesh.triangles])).astype(np.float32)
    blocks = size[0] // BLOCK
    texels = BLOCK * np.stack([number % blocks, number // blocks], axis=-1)[:, None] + _IN_BLOCK
    return SurfelTriangles(
        number=number,
        corners_world=np.einsum("nkc,ncx->nkx", weights, corners),
        normals_world=turned.astype(np.float32),
        uvs=np.zeros((len(local), 3, 2), np.float32)
        if mesh.uvs is None
        else mean(run.per_corner(mesh.uvs)).astype(np.float32),
        texel_uvs=(texels / size).astype(np.float32),
        materials=run.materials()[local],
        links=run.instances.links[run.lo + local // (run.last - run.first)],
        is_back=is_back,
        open=opened,
        layers=layers,
    )


def _in_front(normals: np.ndarray, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit shading normals (N, 3, 3), those that point below the surface turned to its horizon, and `open` (N,).

    Cycles shades what a camera sees by the light from above the surface and around the normal: under an even sky half
    of it at the horizon, less below. A bake, which looks along the normal, would take the surface for its back.
    """
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    cosine = np.einsum("nkx,nkx->nk", normals, flat)[..., None]
    normals = normals + np.maximum(_LEAST_COSINE - cosine, 0.0) * flat
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    return normals, np.clip(1.0 + cosine, 0.0, 1.0).mean(axis=(1, 2)).astype(np.float32)


def _weights(corners: np.ndarray, surfels: np.ndarray) -> np.ndarray:
    """Weights (N, 3, 3) of a triangle's corners in those of its surfel: equilateral, as large as the fragment, and
    within the triangle.
    """
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along = corners[:, 1] - corners[:, 2]  # Cycles' tangent of a triangle, which hair shaders read
    x = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
    normal = np.cross(one, two)
    y = np.cross(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30), x)
    aa, ab, bb = (np.einsum("nx,nx->n", *pair) for pair in ((one, one), (one, two), (two, two)))
    determinant = np.maximum(aa * bb - ab * ab, 1e-300)
    area = np.maximum(surfels["area"], _LEAST_SHARE * 0.5 * np.sqrt(determinant))
    radius = np.sqrt(area / _EQUILATERAL)[:, None]
    centre = np.stack([1.0 - surfels["one"] - surfels["two"], surfels["one"], surfels["two"]], axis=1)
    centre = np.clip(centre.astype(np.float64), 2.0 * _LEAST_WEIGHT, None)
    centre /= centre.sum(axis=1, keepdims=True)
    away = np.empty((len(corners), 3, 3))
    for corner in range(3):
        angle = np.pi * (2.0 * corner / 3.0 - 0.5)
        offset = radius * (np.cos(angle) * x + np.sin(angle) * y)
        p, q = np.einsum("nx,nx->n", offset, one), np.einsum("nx,nx->n", offset, two)
        b, c = (bb * p - ab * q) / determinant, (aa * q - ab * p) / determinant
        away[:, corner] = np.stack([-b - c, b, c], axis=1)
    # Smaller ones where the triangle is narrow: corners that were clipped to it would turn some over.
    room = (centre[:, None] - _LEAST_WEIGHT) / np.maximum(-away, 1e-30)
    scale = np.minimum(room.min(axis=(1, 2)), 1.0)
    return np.asarray(centre[:, None] + scale[:, None, None] * away)
