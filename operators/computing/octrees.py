# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface on a grid, its light, and the octree of both."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.lod.memory import available_memory
from ...patchnet_addon.network.devices import CPU, device_title, found_device
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.leaf_levels import LeafLevels
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.transfer import Remote
from ...patchnet_addon.runtime.progress import Steps, labelled
from ...patchnet_addon.surface.light import SurfaceLight
from ...patchnet_addon.surface.mesh import MeshSource, RotatedSource, ShadingFn, random_rotation
from ..schema.values import BOX_SHAPE, EXACT_SHAPE, TWO_LIGHTS, WHOLE_SHAPE
from ..settings.groups import NETWORK_DEVICE, NetworkSettings
from ..settings.job_settings import JobSettings

if TYPE_CHECKING:  # they bring numba, which only the engine imports
    from ...patchnet_addon.octree.voxelize import ClippedSurface

UNLIT = "none"  # light of an octree that shows the surface's own colour
OWN_ENCODER = "built-in kernels on the CPU"
_FRAGMENTS_SHARE = 1 / 8  # of the memory, for the pieces of the surface in leaves


class CutSurface(NamedTuple):
    """Surface cut into the fragments of its leaves, and how many of these are expected.

    turned: the surface in a random rotation, None without one.
    """

    clipped: Remote[ClippedSurface]
    fragments: float
    turned: Remote[ClippedSurface] | None


@dataclass(frozen=True, eq=False)
class LitSurface:
    """Light of a surface, None where that follows from the surface alone.

    warnings: sentences about what was left out. notes: entries of the octree's file, as plain JSON values. reused:
    share of its paths that an earlier bake had traced.
    """

    light: Remote[SurfaceLight] | None = None
    notes: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    reused: float = 0.0


def cut_surface(
    source: MeshSource, grid: Grid, layout: LeafLevels | None, settings: JobSettings, rotation: int
) -> CutSurface:
    """Cut a surface. rotation: seed of a random one, 0 for none."""
    from ...patchnet_addon.octree.voxelize import ClippedSurface

    keep_bytes, turned = _FRAGMENTS_SHARE * (settings.surface.memory_bytes or available_memory()), None
    clipped = ClippedSurface(source, grid, layout, keep_bytes=keep_bytes, color=settings.light.color)
    if rotation:
        rotated = RotatedSource(source, random_rotation(rotation))
        around = Grid.around(rotated.bounds_world, grid.depth)
        turned = Remote(ClippedSurface(rotated, around, color=settings.light.color))
    return CutSurface(Remote(clipped), clipped.expected, turned)


def _without_bake(source: MeshSource, color: bool, building: Building) -> SurfaceLight:
    """Surface's own colour, or the paper's two lights, from the default direction or a random one."""
    from ...patchnet_addon.surface.shading import DIRECTION, albedo_shade, two_lights_shade

    if building.light == UNLIT:
        return SurfaceLight(albedo_shade(source, color=color), _reflects(source))
    seed = building.rotation
    x, y, z = np.random.default_rng(seed).normal(size=3).tolist() if seed else DIRECTION
    return SurfaceLight(two_lights_shade(source, (x, y, z), color=color), _reflects(source))


def _reflects(source: MeshSource) -> np.ndarray:
    return np.array([max(material.emission) <= 0.0 for material in source.materials])


class Building(NamedTuple):
    """How an octree is built from a surface and its light.

    light: its name in the file. provenance: entries of the file. rotation: seed of a random one that the surface has
    had, 0 for none. bisect: axis and share of a plane at which the lit surface is cut open, None for none. is_last: the
    surface is used a last time.
    """

    light: str
    provenance: dict[str, Any]
    rotation: int = 0
    bisect: tuple[int, float] | None = None
    is_last: bool = True


def build_octree(
    clipped: ClippedSurface,
    turned: ClippedSurface | None,
    lit: SurfaceLight | None,
    settings: JobSettings,
    building: Building,
) -> Steps[Octree]:
    """Octree of a surface in its light, None without a bake; turned: the rotated surface, which is built instead."""
    from ...patchnet_addon.octree.build import build_clipped
    from ...patchnet_addon.octree.voxelize import LeafDetail
    from ...patchnet_addon.surface.texture_lookup import BaseColors

    lit = lit or _without_bake(clipped.source, settings.light.color, building)
    if building.is_last:
        clipped.let_go()
    shade, is_unlit, shape = _shade(clipped, lit, settings, building), building.light == UNLIT, settings.surface.shape
    clipped = turned or clipped
    provenance = {"fitted": clipped.layout.block_level > 0} | building.provenance
    detail = LeafDetail(
        boxes=shape != WHOLE_SHAPE,
        sides=settings.light.has_sides and not is_unlit,
        base=BaseColors(clipped.table, lit.reflects) if shape == EXACT_SHAPE else None,
    )
    exposure = None if is_unlit else settings.light.exposure  # unlit colours are not exposed
    return (yield from build_clipped(clipped, shade, exposure=exposure, provenance=provenance, detail=detail))


def _shade(clipped: ClippedSurface, lit: SurfaceLight, settings: JobSettings, building: Building) -> ShadingFn:
    """Light as the surface is cut or turned."""
    from ...patchnet_addon.light.surface_light import upright_shade
    from ...patchnet_addon.surface.shading import bisected_shade

    if building.bisect is not None:
        return bisected_shade(lit.shade, clipped.source.bounds_world, *building.bisect)
    if building.rotation and settings.light.is_baked and building.light != UNLIT:
        return upright_shade(lit.shade, random_rotation(building.rotation), clipped.grid)
    return lit.shade


def stand_in_octree(source: MeshSource, grid: Grid, settings: JobSettings) -> Steps[Octree]:
    """Coarse octree in two lights without shadows, which is shown before the bake."""
    from ...patchnet_addon.octree.voxelize import ClippedSurface

    clipped = ClippedSurface(source, grid, keep_bytes=0)
    settings = settings.changed(exposure=None, shape=BOX_SHAPE)
    return (yield from build_octree(clipped, None, None, settings, Building(TWO_LIGHTS, {})))


def coded_octree(octree: Octree, weights: Weights, network: NetworkSettings) -> Steps[tuple[CodedOctree, str]]:
    """Codes of all voxels with look-ahead, and the name of the encoder; raises SettingError for a missing device."""
    from ...patchnet_addon.codes.encode import encode_octree

    device = found_device(network.torch_device, NETWORK_DEVICE)
    encoder = OWN_ENCODER if device == CPU else f"torch on {device_title(device)}"
    steps = encode_octree(octree, weights, device=device)
    return (yield from labelled(steps, f"{{}} with {encoder}")), encoder
