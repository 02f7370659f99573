# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of a Cycles render, from its file of all passes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..runtime.errors import SceneError
from ..surface.textures import luminance
from .exr import read_exr

PassLight = Callable[[dict[str, np.ndarray]], np.ndarray]  # (H, W, 3) float32 of the channels of a file
_COLOR = ("DiffCol", "Diffuse Color")  # Blender 4.5's name of a pass, Blender 5's
_EMISSION = ("Emit", "Emission")
_NO_DIFFUSE = 0.02  # of diffuse colour, below which a surface is glossy or clear


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


def read_reference(path: Path) -> Reference:
    """Reference of a file of all passes; raises SceneError without the passes."""
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


class ReadPicture(NamedTuple):
    """Light and alpha (H, W, 4) float32, row 0 at the bottom, and seconds that the file took to read."""

    pixels: np.ndarray
    seconds: float


def picture_of(path: Path, light: PassLight, mask: np.ndarray) -> ReadPicture:
    """Picture of a file of all passes, 0 outside of a mask (H, W) bool; raises SceneError without the passes."""
    begun = time.perf_counter()
    channels = read_exr(path)
    seconds = time.perf_counter() - begun
    pixels = np.dstack([light(channels), coverage(channels)])
    assert pixels.shape == (*mask.shape, 4)
    return ReadPicture(np.where(mask[..., None], pixels, np.float32(0.0)), seconds)


def baked_light(channels: dict[str, np.ndarray]) -> np.ndarray:
    """(H, W, 3) float32, linear and unexposed: diffuse light and emission from a file of all passes."""
    layers = _layers(channels)
    if any(name.startswith("Volume") for name, _ in layers):  # those of all light are there
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
