# SPDX-License-Identifier: GPL-3.0-or-later
"""Shading without a bake: base colours, the paper's two lights (methods 7.3), opacity only, or another shading cut."""

from __future__ import annotations

import numpy as np

from ..runtime.errors import SettingError
from .mesh import Fragments, MeshSource, Shading, ShadingFn, TriangleBatch
from .sides import LIT_BOTH
from .texture_lookup import color_of_fragments, surface_of_fragments
from .textures import TextureTable

# A unit vector not parallel to an axis, so that the faces of a box differ.
DIRECTION = (0.36, -0.48, 0.8)


def albedo_shade(source: MeshSource, *, color: bool = False) -> ShadingFn:
    """ShadingFn with luminance of base colour plus emission, and the material's opacity."""
    return _lit_shade(source, None, color)


def two_lights_shade(
    source: MeshSource, direction: tuple[float, float, float] = DIRECTION, *, color: bool = False
) -> ShadingFn:
    """ShadingFn with luminance albedo * |normal . direction| + emission; both sides of a surface are lit alike.

    Raises SettingError if the direction is zero or not finite.
    """
    towards = np.asarray(direction, np.float64)
    length = float(np.linalg.norm(towards))
    if not (np.isfinite(length) and length > 0.0):
        raise SettingError(f"Light direction {tuple(direction)} is no direction: give a vector that is not zero")
    return _lit_shade(source, towards / length, color)


def _lit_shade(source: MeshSource, towards: np.ndarray | None, color: bool) -> ShadingFn:
    """ShadingFn of base colours, under lights from a direction (3,) and its opposite unless it is None."""
    table = TextureTable.from_materials(source.materials, color=color)

    def shade(batch: TriangleBatch, fragments: Fragments) -> Shading:
        reflected, opacity = surface_of_fragments(table, batch, fragments)
        if towards is not None:
            reflected *= _cosines(batch, fragments, towards)
        materials = batch.materials[fragments.triangle]
        luminance = reflected + table.materials.emission[materials]
        lit = np.full(len(batch), LIT_BOTH, np.int8)
        if not color:
            return Shading(luminance, opacity, lit=lit)
        base = color_of_fragments(table, batch, fragments, reflected)
        return Shading(luminance, opacity, base + table.materials.glow[materials], lit=lit)

    return shade


def _cosines(batch: TriangleBatch, fragments: Fragments, towards: np.ndarray) -> np.ndarray:
    """|n . d| (F,) float32; fragments have triangles in ascending order, so only those in their range are computed."""
    if not len(fragments):
        return np.empty(0, np.float32)
    first, last = int(fragments.triangle.min()), int(fragments.triangle.max()) + 1
    corners = batch.corners_world[first:last]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    # Column by column: rounding of a matrix product depends on its size, and so on the order of triangles.
    cosine = np.abs(sum(normals[:, axis] * towards[axis] for axis in range(3))) / length
    return cosine.astype(np.float32)[fragments.triangle - first]


def opacity_shade(source: MeshSource, table: TextureTable | None = None) -> ShadingFn:
    """Shading without luminance, with the lit surface's opacity; only cut-outs are looked up (methods 7.2a).

    table: of its materials, if there is one.
    """
    table = table or TextureTable.from_materials(source.materials)
    cut_out = ~np.append(table.chains.solid.astype(bool), True)[table.materials.chain]  # the last: no texture

    def shade(batch: TriangleBatch, fragments: Fragments) -> Shading:
        if fragments.surface is not None:
            return Shading(np.zeros(len(fragments), np.float32), fragments.surface[1])
        materials = batch.materials[fragments.triangle]
        opacity = table.materials.opacity[materials].astype(np.float32)
        chosen = np.flatnonzero(cut_out[materials])
        if len(chosen):
            part = fragments.only(chosen)
            opacity[chosen] = surface_of_fragments(table, batch, part)[1]
        return Shading(np.zeros(len(fragments), np.float32), opacity)

    return shade


def bisected_shade(shade: ShadingFn, bounds_world: np.ndarray, axis: int, share: float) -> ShadingFn:
    """ShadingFn like `shade` without opacity for fragments whose centroids lie beyond a plane, so that they make no
    voxels.

    bounds_world: (2, 3) box of the surface. axis: 0, 1 or 2. share: position of the plane between the box's lowest and
    highest corner, 0 to 1. The cut is as even as leaves are small, for triangles of any size.
    """
    low, high = bounds_world[:, axis]
    plane_world = low + share * (high - low)

    def bisected(batch: TriangleBatch, fragments: Fragments) -> Shading:
        shading = shade(batch, fragments)
        first, second, third = batch.corners_world[fragments.triangle, :, axis].T
        u, v = fragments.barycentric.T
        beyond = first + u * (second - first) + v * (third - first) > plane_world
        return shading._replace(opacity=np.where(beyond, np.float32(0.0), shading.opacity))

    return bisected
