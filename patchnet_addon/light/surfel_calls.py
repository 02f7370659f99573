# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of Cycles that bake surfels: the triangles of each, and the light of surfels from the images that it fills."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..process.transfer import Remote
from ..surface.chroma import REC709
from ..surface.scene_mesh import SceneMesh
from ..surface.triangles import triangle_areas_and_normals
from .surfel_triangles import BLOCK, PARTS, SurfelTriangles, surfel_triangles

_LEAST_COLOR = 1e-3  # of a baked base color: Cycles ends paths on darker ones


class Passes(NamedTuple):
    """Passes of one call: through: only translucent light from behind, or all but that. gloss: with it or without.

    colors: colours instead of light.
    """

    through: bool = False
    gloss: bool = False
    colors: bool = False


DIFFUSE, GLOSSY, THROUGH, COLORS = Passes(), Passes(gloss=True), Passes(through=True), Passes(colors=True)


class BakedMaterials(NamedTuple):
    """(M,) bool each: materials that show at all, that are baked with gloss, that light shines through, whose colours
    are baked, and that emit light.
    """

    shown: np.ndarray
    with_gloss: np.ndarray
    translucent: np.ndarray
    color_is_baked: np.ndarray
    shines: np.ndarray


class CallsInput(NamedTuple):
    """How surfels are baked.

    coordinates: name of a layer for object coordinates, "" for none. channels: of the light, with opacity. lift_world:
    height of triangles above the surface. most: triangles of a call. colors: base colours instead of light.
    """

    materials: BakedMaterials
    coordinates: str
    channels: int
    lift_world: float
    most: int
    colors: bool


class PlannedCall(NamedTuple):
    """Call of Cycles: its number, index into the source's `light_links`, passes, triangles, and whether their colours
    are baked after it, which light is divided by.
    """

    number: int
    links: int
    passes: Passes
    triangles: int
    is_divided: bool


class PlannedCalls(NamedTuple):
    """Calls for some surfels, and width and height of their images."""

    work: Remote[SurfelCalls]
    size: tuple[int, int]
    calls: list[PlannedCall]


class CallMesh(NamedTuple):
    """Mesh of N triangles for a call, with the lit side as their front.

    corners_world, normals_world: (N, 3, 3) float32. uvs, texel_uvs: (N, 3, 2) float32, of the surface and on the image.
    materials: (N,) int32 into `used`, pairs of a material of the source and whether its back is lit, fronts first.
    layers: corner layers by name, (N, 3, C) float32.
    """

    corners_world: np.ndarray
    normals_world: np.ndarray
    uvs: np.ndarray
    texel_uvs: np.ndarray
    materials: np.ndarray
    used: list[tuple[int, bool]]
    layers: dict[str, np.ndarray]


@dataclass(eq=False)
class SurfelCalls:
    """Triangles (T) of N surfels, rows (n,) of them of each call, and light (N, PARTS, channels) so far.

    A surfel has two texels, each with half of its paths, so that their difference tells its noise.
    """

    triangles: SurfelTriangles
    size: tuple[int, int]
    how: CallsInput
    light: np.ndarray
    rows: list[np.ndarray]

    def chosen(self, number: int, passes: Passes) -> np.ndarray:
        """Rows (n,) of a call; of its colours, if these are baked after light, only those that it is divided by."""
        rows = self.rows[number]
        if passes.colors and not self.how.colors:
            return rows[self.how.materials.color_is_baked[self.triangles.materials[rows]]]
        return rows


def plan_calls(source: SceneMesh, surfels: np.ndarray, how: CallsInput) -> PlannedCalls:
    """Calls that bake surfels (N,) SURFEL: different light links, translucent light and gloss have their own.

    Blender and Cycles hold copies of all triangles of a call.
    """
    blocks = 1 << max(1, int(np.ceil(np.log2(np.sqrt(len(surfels))))))
    size = BLOCK * blocks, BLOCK * max(2, -(-len(surfels) // blocks))
    triangles = surfel_triangles(source, surfels, size, how.coordinates)
    if not how.materials.shown.all():
        triangles = triangles.only(how.materials.shown[triangles.materials])
    work = SurfelCalls(triangles, size, how, np.zeros((len(surfels), PARTS, how.channels), np.float32), [])
    calls: list[PlannedCall] = []
    for links in np.unique(triangles.links).tolist():
        for passes in (COLORS,) if how.colors else (DIFFUSE, GLOSSY, THROUGH):
            mine = np.flatnonzero((triangles.links == links) & _has(how.materials, passes)[triangles.materials])
            for first in range(0, len(mine), how.most):
                rows = mine[first : first + how.most]
                divided = how.materials.color_is_baked[triangles.materials[rows]]
                is_divided = passes == DIFFUSE and bool(divided.any())
                calls.append(PlannedCall(len(work.rows), links, passes, len(rows), is_divided))
                work.rows.append(rows)
    return PlannedCalls(Remote(work), size, calls)


def _has(materials: BakedMaterials, passes: Passes) -> np.ndarray:
    """(M,) bool: materials with light in a call's passes."""
    if passes.through:
        return materials.translucent
    return materials.with_gloss == passes.gloss if not passes.colors else np.ones(len(materials.shown), bool)


def mesh_of(work: SurfelCalls, number: int, passes: Passes) -> CallMesh:
    """Mesh of a call, lifted off the surface, or below it for light that shines through."""
    part = work.triangles.only(work.chosen(number, passes))
    count = len(work.how.materials.shown)
    # Materials of fronts, then those of backs.
    used, mine = np.unique(part.materials + count * part.is_back, return_inverse=True)
    lift_world = -work.how.lift_world if passes.through else work.how.lift_world
    corners_world = part.corners_world + triangle_areas_and_normals(part.corners_world)[1][:, None] * lift_world
    return CallMesh(
        corners_world=corners_world.astype(np.float32),
        normals_world=np.ascontiguousarray(part.normals_world, np.float32),
        uvs=np.ascontiguousarray(part.uvs, np.float32),
        texel_uvs=np.ascontiguousarray(part.texel_uvs, np.float32),
        materials=mine.reshape(-1).astype(np.int32),
        used=[(each % count, each >= count) for each in used.tolist()],
        layers={name: np.ascontiguousarray(values, np.float32) for name, values in part.layers.items()},
    )


def add_call(work: SurfelCalls, call: PlannedCall, pixels: np.ndarray, colors: np.ndarray | None) -> None:
    """Add the light of a call from the pixels (height * width * 4,) of its image; colors: those of its base colours.

    Light of materials whose colours are baked is over the base colour, without opacity where that is black.
    """
    values, rows = _values(work, call, call.passes, pixels), work.chosen(call.number, call.passes)
    materials = work.triangles.materials[rows]
    if colors is not None:
        divided = work.how.materials.color_is_baked[materials]
        values[divided] = _over(values[divided], _values(work, call, COLORS, colors))
    if call.passes.through:
        values[..., -1] = 0.0  # opacity counts once
    if not work.how.colors:
        shines = work.how.materials.shines[materials]
        values[..., :-1] *= np.where(shines, 1.0, work.triangles.open[rows])[:, None, None]
    work.light[work.triangles.number[rows]] += values


def finished_light(work: SurfelCalls) -> np.ndarray:
    """Light (N, channels + 1) float32 of all surfels: mean of both texels, and half the difference of luminance."""
    half = 0.5 * (work.light[:, 0, 0] - work.light[:, 1, 0])
    return np.concatenate([work.light.mean(axis=1), half[:, None]], axis=1)


def _values(work: SurfelCalls, call: PlannedCall, passes: Passes, pixels: np.ndarray) -> np.ndarray:
    """Light (n, PARTS, channels) of the triangles of a call."""
    (width, height), channels = work.size, work.how.channels
    light = _light_of(pixels, channels)
    texels = light.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, -1)[:, 0, :, :PARTS]
    numbers = work.triangles.number[work.chosen(call.number, passes)]
    return np.asarray(texels.reshape(-1, PARTS, channels)[numbers])


def _light_of(pixels: np.ndarray, channels: int) -> np.ndarray:
    """Light (n, channels) float32 of the texels of a baked image."""
    pixels = np.nan_to_num(pixels.reshape(-1, 4), posinf=0.0, neginf=0.0)
    light = np.empty((len(pixels), channels), np.float32)
    light[:, 0] = np.maximum(pixels[:, :3] @ REC709, 0.0)
    if channels > 2:  # with colour
        light[:, 1:4] = np.maximum(pixels[:, :3], 0.0)
    light[:, -1] = np.clip(pixels[:, 3], 0.0, 1.0)
    return light


def _over(light: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Light (..., C) over the base colour that the same paths met; transparent where that is black."""
    result = np.where(base > _LEAST_COLOR, light / np.maximum(base, _LEAST_COLOR), np.float32(0.0))
    result[..., -1] = light[..., -1] * (base[..., 0] > _LEAST_COLOR)
    return result
