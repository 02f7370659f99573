# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance weights from painted images: white matters, black does not."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.surface.chroma import REC709


def painted_image(name: str) -> np.ndarray:
    """(h, w) float32 of an image of the open file, row 0 at the bottom; raises SettingError."""
    image = bpy.data.images.get(name)
    if image is None:
        raise SettingError(f"There is no image '{name}' for the importance: choose one that is there")
    return _values(image)


def painted_file(path: Path) -> np.ndarray:
    """(h, w) float32 of an image file, row 0 at the bottom; raises SettingError."""
    if not path.is_file():
        raise SettingError(f"The importance mask {path} does not exist: give the file of a painted image")
    try:
        image = bpy.data.images.load(str(path), check_existing=False)
    except RuntimeError as cause:
        raise SettingError(f"The importance mask {path} cannot be read as an image: give a .png or .exr") from cause
    try:
        image.colorspace_settings.name = "Non-Color"
        return _values(image)
    finally:
        bpy.data.images.remove(image)


def _values(image: bpy.types.Image) -> np.ndarray:
    """Gray value of the pixels as they are stored, times alpha."""
    width, height = image.size
    channels = image.channels
    if not width * height * channels:
        raise SettingError(f"Image '{image.name}' has no pixels: its file is missing, or nothing was painted yet")
    pixels = np.empty(width * height * channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, channels)
    gray = pixels[..., :3] @ REC709 if channels >= 3 else pixels[..., 0]
    return gray * pixels[..., -1] if channels in (2, 4) else gray
