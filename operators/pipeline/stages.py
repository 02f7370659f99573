# SPDX-License-Identifier: GPL-3.0-or-later
"""Stages of a job, each a function of the previous result: surface, grid, lit octree, codes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.network.devices import AUTO, CPU, device_title, found_device, torch_has_gpu
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.bounds import MAX_DEPTH
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.runtime.quantities import named_list
from ...patchnet_addon.runtime.worker import computed, run_in_worker
from ...patchnet_addon.surface.mesh import MeshSource, ShadingFn
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.empty_view import BLACK_SURFACE
from ..scene.precision import place_warnings
from ..schema.values import EXACT_SHAPE, LIGHT, OCTREE, WHOLE_SHAPE
from ..settings.groups import NETWORK_DEVICE, LightSettings, NetworkSettings
from ..settings.job_settings import JobSettings, recorded
from .reports import versions

if TYPE_CHECKING:  # needed only when an octree is built
    from ...patchnet_addon.light.surface_light import SurfaceLight
    from ...patchnet_addon.lod.fitted_levels import FittedLevels
    from ...patchnet_addon.octree.leaf_levels import LeafLevels
    from ...patchnet_addon.octree.voxelize import ClippedSurface

UNLIT = "none"  # light of an octree that shows the surface's own colour
_OWN_ENCODER = "built-in kernels on the CPU"
_TEXTURES, _ENCODING = Progress(0, 1, "Reading textures"), Progress(0, 1, "Encoding")
NO_LIGHT = "The scene has no light: it was lit with a sun and a sky"


@dataclass(frozen=True, eq=False)
class GridChoice:
    """Grid of the octree, the levels of its leaves (None: all on the deepest), and warnings.

    leaves: approximate number of leaves; 0 if unknown. cameras: those that it was chosen for, or that see it.
    """

    grid: Grid
    layout: LeafLevels | None = None
    warnings: tuple[str, ...] = ()
    leaves: int = 0
    cameras: Sequence[Camera] = ()


def choose_grid(source: SceneMesh, cameras: Sequence[Camera], settings: JobSettings) -> Steps[GridChoice]:
    """Grid around the surface by the settings' depth or voxel size, else with leaves fitted to the cameras.

    Raises MemoryEstimateError, before anything is built, if a given depth does not fit into memory, and GeometryError
    for a surface too far from the origin.
    """
    make = _fitted_grid if settings.surface.is_fitted else _even_grid
    choice = yield from run_in_worker(lambda: make(source, cameras, settings), Progress(0, 1, "Finding the depth"))
    return replace(choice, warnings=(*place_warnings(source, choice.grid), *choice.warnings))


def _even_grid(source: MeshSource, _cameras: Sequence[Camera], settings: JobSettings) -> Steps[GridChoice]:
    """Grid of a given depth or voxel size."""
    from ...patchnet_addon.lod.depth import coarse_octree
    from ...patchnet_addon.lod.memory import check_memory, expected_leaves

    grid = settings.surface.given_grid(source)
    bounds_world = settings.surface.bounds_world(source)
    coarse = yield from labelled(coarse_octree(source, bounds_world=bounds_world), "Finding the depth")
    leaves = expected_leaves(coarse, grid.depth)
    check_memory(leaves, grid.depth, settings.surface.memory_bytes, settings.contents)
    return GridChoice(grid, leaves=leaves)


def _fitted_grid(source: MeshSource, cameras: Sequence[Camera], settings: JobSettings) -> Steps[GridChoice]:
    """Grid with leaves as deep as the cameras need, within the memory limit."""
    from ...patchnet_addon.lod.fitted_levels import LOOK_AHEAD_SHARE

    grid, fitted = yield from fitted_levels(source, cameras, settings)
    warnings: tuple[str, ...] = ()
    if fitted.lookahead_share is not None and fitted.lookahead_share < LOOK_AHEAD_SHARE:
        warnings = (
            f"The cameras need leaves down to level {fitted.wanted}, more than memory or depth allow: about "
            f"{fitted.lookahead_share:.0%} of pixels will have look-ahead; choose smaller pictures or fewer cameras",
        )
    return GridChoice(grid, fitted.layout, warnings, fitted.leaves)


def fitted_levels(
    source: MeshSource, cameras: Sequence[Camera], settings: JobSettings, *, rough: bool = False
) -> Steps[tuple[Grid, FittedLevels]]:
    """Grid and levels of leaves for the cameras, within the memory limit; `rough`: an estimate, in less time."""
    from ...patchnet_addon.lod.fit import fit_leaf_levels
    from ...patchnet_addon.lod.fitted_levels import LAYOUT_BYTES
    from ...patchnet_addon.lod.memory import available_memory, max_leaves
    from ...patchnet_addon.surface.shading import opacity_shade

    grid = Grid.around(settings.surface.bounds_world(source), MAX_DEPTH)
    memory = settings.surface.memory_bytes or available_memory()
    most = max_leaves(memory - LAYOUT_BYTES, settings.contents)
    lookahead, shade = load_network(settings.network).lookahead, opacity_shade(source)
    fitting = fit_leaf_levels(source, grid, cameras, shade, max_leaves=most, lookahead=lookahead, rough=rough)
    fitted = yield from fitting
    return replace(grid, depth=fitted.layout.deepest), fitted


def unlit(source: MeshSource, light: LightSettings) -> Steps[SurfaceLight]:
    """Colour of the surface itself, before any light is baked."""
    from ...patchnet_addon.surface.shading import albedo_shade

    return _lit(source, lambda: albedo_shade(source, color=light.color))


def two_lights(source: MeshSource, light: LightSettings, rotation: int = 0) -> Steps[SurfaceLight]:
    """Surface in the paper's two lights, from the default direction or a random one."""
    from ...patchnet_addon.surface.shading import DIRECTION, two_lights_shade

    x, y, z = np.random.default_rng(rotation).normal(size=3).tolist() if rotation else DIRECTION
    return _lit(source, lambda: two_lights_shade(source, (x, y, z), color=light.color))


def _lit(source: MeshSource, make: Callable[[], ShadingFn]) -> Steps[SurfaceLight]:
    """Light of a surface without a bake."""
    from ...patchnet_addon.light.surface_light import SurfaceLight

    shade = yield from computed(make, _TEXTURES)
    reflects = np.array([max(material.emission) <= 0.0 for material in source.materials])
    return SurfaceLight(shade, reflects)


def build(
    clipped: ClippedSurface, lit: SurfaceLight, settings: JobSettings, light: str, provenance: dict[str, Any]
) -> Steps[Octree]:
    """Build the octree of a surface in its light, which `light` names in its file.

    provenance: further entries of the file, which replace the default ones.
    """
    from ...patchnet_addon.octree.build import build_clipped
    from ...patchnet_addon.octree.voxelize import LeafDetail
    from ...patchnet_addon.surface.texture_lookup import BaseColors

    fitted = {"fitted": clipped.layout.block_level > 0}
    provenance = _provenance(clipped.source, settings, light) | fitted | lit.notes | provenance
    exposure = settings.light.exposure if light != UNLIT else None  # unlit colours are not exposed
    if light == UNLIT:
        del provenance["exposure"]
    else:
        provenance["exposure"] = "automatic" if exposure is None else "given"
    shape = settings.surface.shape
    base = None
    if shape == EXACT_SHAPE:
        table = yield from computed(lambda: clipped.table, _TEXTURES)
        base = BaseColors(table, lit.reflects)
    detail = LeafDetail(boxes=shape != WHOLE_SHAPE, sides=settings.light.has_sides and light != UNLIT, base=base)

    def make() -> Steps[Octree]:
        return build_clipped(clipped, lit.shade, exposure=exposure, provenance=provenance, detail=detail)

    return (yield from run_in_worker(make, Progress(0, 1, "Voxelizing")))


def _provenance(source: MeshSource, settings: JobSettings, light: str) -> dict[str, Any]:
    """Provenance of an octree; the scene's file is named without its folder, for privacy."""
    values = {
        "file": Path(bpy.data.filepath).name,
        "scene": bpy.context.scene.name,
        "frame": bpy.context.scene.frame_current,
        "triangles": source.triangle_count,
        "versions": versions(),
    }
    chosen = settings.values
    chosen.light = light
    values |= recorded(chosen, OCTREE, LIGHT)
    values.pop("track_frames", None)  # tracks by other words make the same file
    if all(max(*material.base_color, *material.emission) <= 0.0 for material in source.materials):
        values[BLACK_SURFACE] = named_list(material.name for material in source.materials)
    return values


def load_network(network: NetworkSettings) -> Weights:
    """Load the weights of the settings, or the shipped ones; raises WeightsFileError."""
    from ...patchnet_addon.network.weights import load_weights

    return load_weights(network.weights)


def encode(octree: Octree, weights: Weights, network: NetworkSettings) -> Steps[tuple[CodedOctree, str]]:
    """Codes of all voxels with look-ahead, and the name of the encoder; raises SettingError for a missing device."""
    from ...patchnet_addon.codes.encode import encode_octree

    yield _ENCODING
    device = found_device(network.torch_device, NETWORK_DEVICE)
    encoder = _OWN_ENCODER if device == CPU else f"torch on {device_title(device)}"
    steps = run_in_worker(lambda: encode_octree(octree, weights, device=device), _ENCODING)
    return (yield from labelled(steps, f"{{}} with {encoder}")), encoder


def encoder_text(network: NetworkSettings) -> str:
    """Name of the encoder that the settings choose, without loading torch where that is not needed."""
    has_gpu = network.torch_device != CPU and (network.torch_device != AUTO or torch_has_gpu())
    return "torch on a GPU" if has_gpu else _OWN_ENCODER
