# SPDX-License-Identifier: GPL-3.0-or-later
"""Stages of a job, each a function of the previous result: surface, grid, lit octree, codes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.network.devices import AUTO, CPU, torch_has_gpu
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import answer, computed
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.quantities import named_list
from ...patchnet_addon.surface.mesh import MeshSource
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.empty_view import BLACK_SURFACE
from ..computing.grids import GridChoice, chosen_grid
from ..computing.octrees import OWN_ENCODER, UNLIT, coded_octree
from ..scene.precision import place_warnings
from ..schema.values import LIGHT, OCTREE
from ..settings.groups import NetworkSettings
from ..settings.job_settings import JobSettings, recorded
from .reports import versions

NO_LIGHT = "The scene has no light: it was lit with a sun and a sky"


def choose_grid(source: SceneMesh, cameras: Sequence[Camera], settings: JobSettings) -> Steps[GridChoice]:
    """Grid around the surface by the settings' depth or voxel size, else with leaves fitted to the cameras.

    Raises MemoryEstimateError, before anything is built, if a given depth does not fit into memory, and GeometryError
    for a surface too far from the origin.
    """
    finding = Progress(0, 1, "Finding the depth")
    choice: GridChoice = yield from computed(chosen_grid, source, tuple(cameras), settings, at=finding)
    return replace(choice, warnings=(*place_warnings(source, choice.grid), *choice.warnings))


def provenance(source: MeshSource, settings: JobSettings, light: str) -> dict[str, Any]:
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
    if light == UNLIT:
        del values["exposure"]
    else:
        values["exposure"] = "automatic" if settings.light.exposure is None else "given"
    return values


def encode(octree: Octree, weights: Weights, network: NetworkSettings) -> Steps[tuple[CodedOctree, str]]:
    """Codes of all voxels with look-ahead, and the name of the encoder; raises SettingError for a missing device."""
    return (yield from computed(coded_octree, octree, weights, network, at=Progress(0, 1, "Encoding")))


def encoder_text(network: NetworkSettings) -> str:
    """Name of the encoder that the settings choose, without loading torch where that is not needed."""
    has_gpu = network.torch_device != CPU and (network.torch_device != AUTO or answer(torch_has_gpu))
    return "torch on a GPU" if has_gpu else OWN_ENCODER
