# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles reference render of the baked light, diffuse light and emission, through a camera of the tracer.

Direct and indirect diffuse light times diffuse colour, plus emission, equals a combined bake of these parts. The passes
are read from a multi-layer EXR, which neither the compositor nor view settings affect.
"""

from __future__ import annotations

import tempfile
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.image.exr import read_exr
from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.surface.textures import luminance
from ...patchnet_addon.tracing.camera import Camera
from .daylight import daylight, has_light
from .scene_copy import prepared, render

_PASSES = (
    "use_pass_combined", "use_pass_z", "use_pass_normal", "use_pass_diffuse_direct", "use_pass_diffuse_indirect",
    "use_pass_diffuse_color", "use_pass_emit",
)  # fmt: skip
# What Fast GI adds is in Combined and in bakes, but in no pass: it is what these passes leave of Combined.
_OTHERS = [f"use_pass_{kind}_{part}" for kind in ("glossy", "transmission", "volume")
           for part in ("direct", "indirect", "color")]  # fmt: skip
_COLOR = ("DiffCol", "Diffuse Color")  # Blender 4.5's name of a pass, Blender 5's
_EMISSION = ("Emit", "Emission")
_NO_DIFFUSE = 0.02  # of diffuse colour, below which a surface is glossy or clear


def render_halves(context: bpy.types.Context, camera: Camera, samples: int) -> Steps[list[Reference]]:
    """Two renders of half the samples each, in the light of the bake; raises SceneError as `render_reference`."""
    halves: list[Reference] = []
    for seed in (1, 2):
        yield Progress(len(halves), 2, "Cycles")
        lit = has_light(context.evaluated_depsgraph_get())
        with nullcontext() if lit else daylight(context.scene):
            halves.append(render_reference(context, camera, samples // 2, seed))
    return halves


@dataclass(frozen=True, eq=False)
class Reference:
    """Render, row 0 at the bottom, over black.

    luminance: (H, W) float32 of diffuse light and emission, unexposed. combined: (H, W) float32 of all light, gloss
    and glass included. coverage, depth_world, albedo: (H, W). normal: (H, W, 3).
    """

    luminance: np.ndarray
    combined: np.ndarray
    coverage: np.ndarray
    depth_world: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray


def render_reference(context: bpy.types.Context, camera: Camera, samples: int, seed: int) -> Reference:
    """Render a copy of the scene; raises SceneError if Cycles is missing or fails."""
    with tempfile.TemporaryDirectory(prefix="patchnet-") as folder:
        path = Path(folder) / "reference.exr"
        with prepared(context, camera, samples, seed, path) as (scene, layer):
            add_passes(layer)
            render(scene, path)
        channels = read_exr(path)
    layers = _layers(channels)
    return Reference(
        luminance=luminance(baked_light(channels)),
        combined=luminance(combined_light(channels)),
        coverage=layers["Combined", "A"],
        depth_world=layers["Depth", "Z"],
        albedo=luminance(_color(layers, _COLOR)),
        normal=np.stack([layers["Normal", axis] for axis in "XYZ"], axis=-1),
    )


def add_passes(layer: bpy.types.ViewLayer) -> None:
    """Enable the passes that this module reads in a view layer of a copied scene."""
    cycles = layer.id_data.cycles
    others = _OTHERS if cycles.use_fast_gi and cycles.fast_gi_method == "ADD" else ()
    for name in (*_PASSES, *others):
        for owner in (layer, layer.cycles):
            if hasattr(owner, name):
                setattr(owner, name, True)


def baked_light(channels: dict[str, np.ndarray]) -> np.ndarray:
    """(H, W, 3) float32, linear and unexposed: diffuse light and emission from a file of all passes."""
    layers = _layers(channels)
    if any(name.startswith("Volume") for name, _ in layers):  # those of _OTHERS are there
        others = _reflected(layers, "Gloss", "Glossy") + _reflected(layers, "Trans", "Transmission")
        left = _color(layers, ("Combined",)) - others - _arriving(layers, "Volume", "Volume")
        return np.maximum(np.nan_to_num(left), np.float32(0.0))
    return np.nan_to_num(_reflected(layers, "Diff", "Diffuse") + _color(layers, _EMISSION))


def _reflected(layers: dict[tuple[str, ...], np.ndarray], old: str, new: str) -> np.ndarray:
    return _arriving(layers, old, new) * _color(layers, (f"{old}Col", f"{new} Color"))


def _arriving(layers: dict[tuple[str, ...], np.ndarray], old: str, new: str) -> np.ndarray:
    return _color(layers, (f"{old}Dir", f"{new} Direct")) + _color(layers, (f"{old}Ind", f"{new} Indirect"))


def baked_light_with_gloss(channels: dict[str, np.ndarray]) -> np.ndarray:
    """(H, W, 3) float32: `baked_light`, but all light on surfaces without diffuse colour, such as metals."""
    layers = _layers(channels)
    glossy = _color(layers, _COLOR).max(axis=-1, keepdims=True) < _NO_DIFFUSE
    return np.where(glossy, combined_light(channels), baked_light(channels))


def combined_light(channels: dict[str, np.ndarray]) -> np.ndarray:
    """(H, W, 3) float32, linear and unexposed: all light, over black."""
    return np.nan_to_num(_color(_layers(channels), ("Combined",)))


def coverage(channels: dict[str, np.ndarray]) -> np.ndarray:
    """(H, W) float32: alpha."""
    return np.nan_to_num(_layers(channels)["Combined", "A"]).astype(np.float32)


def _layers(channels: dict[str, np.ndarray]) -> dict[tuple[str, ...], np.ndarray]:
    """Channels by pass and channel, without the view layer's name."""
    return {tuple(name.split(".")[-2:]): values for name, values in channels.items()}


def _color(layers: dict[tuple[str, ...], np.ndarray], names: tuple[str, ...]) -> np.ndarray:
    """(H, W, 3): the pass by the first of its names in the file."""
    name = next((each for each in names if (each, "R") in layers), None)
    if name is None:
        raise SceneError(f"Cycles rendered no pass {names[0]}: the view layer may belong to another engine")
    return np.stack([layers[name, channel] for channel in "RGB"], axis=-1)
