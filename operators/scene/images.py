# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender images as linear arrays."""

from __future__ import annotations

import bpy
import numpy as np

from ...patchnet_addon.surface.chroma import CHANNEL_WEIGHTS, CHANNELS
from ..scene_access.blender_version import ALPHA_MODES_ARE_OF_PIXELS
from .node_terms import TextureUse

_SQUARES_SIDE = 512  # largest side of enlarged images with square texels; they reach at least half of it
_RAW_SPACES = frozenset({"Non-Color", "Raw"})
_ALPHA_COVERS = frozenset({"STRAIGHT", "PREMUL"})  # alpha modes in which Cycles multiplies colours by alpha
# Pixels whose bilinear value at `RAMP_TRANSFORM` of (u, v, 1) is u.
RAMP = np.linspace(0.0, 1.0, 256, dtype=np.float32).reshape(1, 256, 1)
RAMP_TRANSFORM = ((255 / 256, 0.0, 0.5 / 256), (0.0, 0.0, 0.5))


class ImageReader:
    """Reader that reads each image once; materials that share an image share its array."""

    def __init__(self) -> None:
        self._colors: dict[tuple[str, bool], np.ndarray] = {}
        self._channels: dict[tuple[str, bool, str], np.ndarray] = {}
        self._squares: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def color(self, use: TextureUse) -> np.ndarray:
        """(H, W, 3) float32, linear; row 0 at v = 0. Alpha counts as in Cycles, see `TextureUse`."""
        assert use.image is not None
        key = use.image.name_full, use.straight
        if key not in self._colors:
            self._read(use.image, straight=use.straight)
        return self._colors[key]

    def channel(self, use: TextureUse, channel: str) -> np.ndarray:
        """(H, W, 1) float32: "A", or linear "R", "G", "B", luminance "Y", or "MEAN"; `RAMP` without an image."""
        if use.image is None:
            return RAMP
        key = use.image.name_full, use.straight, channel
        if key not in self._channels and channel == "A":
            self._read(use.image, straight=use.straight)
        if key not in self._channels:
            color = self.color(use)
            values = color @ CHANNEL_WEIGHTS[channel] if channel in CHANNEL_WEIGHTS else color[..., CHANNELS[channel]]
            self._channels[key] = np.ascontiguousarray(values[..., None])
        return self._channels[key]

    def squares(self, pixels: np.ndarray) -> np.ndarray:
        """Enlarge small pixels (H, W, C) so that bilinear lookups show them as squares, as Closest interpolation."""
        if id(pixels) not in self._squares:
            times = _SQUARES_SIDE // max(pixels.shape[:2])
            large = pixels.repeat(times, axis=0).repeat(times, axis=1) if times > 1 else pixels
            self._squares[id(pixels)] = pixels, large
        return self._squares[id(pixels)][1]

    def mean(self, use: TextureUse) -> np.ndarray:
        """Mean colour (3,), linear."""
        color = self.color(use)  # the sum over rows first: a sixth of the time
        return (
            color.reshape(len(color), -1).sum(axis=0, dtype=np.float64).reshape(-1, 3).sum(axis=0) / color[..., 0].size
        )

    def _read(self, image: bpy.types.Image, *, straight: bool) -> None:
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        was_loaded = image.has_data
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(height, width, image.channels)
        if not was_loaded and not image.is_dirty:
            image.buffers_free()
        color = pixels[..., :3] if image.channels >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)
        if image.channels == 4 and image.alpha_mode != "NONE":
            alpha = np.clip(np.nan_to_num(pixels[..., 3:]), 0.0, 1.0)
        else:
            alpha = np.ones((height, width, 1), np.float32)
        if image.alpha_mode in _ALPHA_COVERS and image.colorspace_settings.name not in _RAW_SPACES:
            multiplied = image.alpha_mode == "PREMUL" if ALPHA_MODES_ARE_OF_PIXELS else image.is_float
            color = _covered(color, alpha, multiplied=multiplied, straight=straight)
        key = image.name_full, straight
        self._colors[key] = _linear(np.ascontiguousarray(color), image)
        self._channels[*key, "A"] = alpha


def _covered(color: np.ndarray, alpha: np.ndarray, *, multiplied: bool, straight: bool) -> np.ndarray:
    """Colour times alpha, or straight, of pixels that are `multiplied` or straight; encoded, as in Cycles."""
    if multiplied:
        return color / np.where(alpha > 0.0, alpha, 1.0) if straight else color
    return color if straight else color * alpha


def usable(image: bpy.types.Image | None) -> bool:
    """Return whether the image has pixels that can be read as one rectangle."""
    return image is not None and image.source != "TILED" and min(image.size) > 0 and image.channels > 0


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """Inverse of the sRGB transfer function (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


# Images of 8 bits a channel have only these values.
_BYTE_TO_LINEAR = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)


def _linear(color: np.ndarray, image: bpy.types.Image) -> np.ndarray:
    """Convert to linear: Blender stores float images scene-linear, and 8 bit images as encoded in the file."""
    space = image.colorspace_settings.name
    if image.is_float or space in _RAW_SPACES or space.startswith("Linear"):
        return np.nan_to_num(color, posinf=0.0, neginf=0.0)
    if color.max(initial=0.0) > 1.0:  # divided by alpha
        return srgb_to_linear(np.maximum(color, 0.0))
    return _BYTE_TO_LINEAR[(np.clip(color, 0.0, 1.0) * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)]
