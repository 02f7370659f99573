# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures for notebook pages: Blender images side by side.

show("PatchNet Preview", "PatchNet Heatmap")
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import bpy  # noqa: TID251
import numpy as np

from patchnet.operators.scene_access.images import save_png

GAP_PX = 8


@dataclass(frozen=True)
class Picture:
    """Picture as the bytes of a PNG file, which notebooks display."""

    png: bytes = field(repr=False)
    width: int
    height: int

    def _repr_png_(self) -> bytes:
        return self.png


def pixels_of(name: str) -> np.ndarray:
    """Pixels (H, W, 3) float32 of a Blender image, row 0 at the bottom; raises KeyError if there is none."""
    image = bpy.data.images[name]
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], image.channels)[..., :3]


def beside(pictures: list[np.ndarray], rows: int = 580) -> np.ndarray:
    """Pictures side by side on white, (H, W, 3), each magnified by an integer to about `rows` rows."""
    large = []
    for picture in pictures:
        times = max(1, rows // len(picture))
        large.append(np.repeat(np.repeat(picture, times, 0), times, 1))
    height = max(len(picture) for picture in large)
    parts = []
    for picture in large:
        page = np.ones((height, picture.shape[1] + GAP_PX, 3), np.float32)
        page[height - len(picture) :, : picture.shape[1]] = picture
        parts.append(page)
    return np.concatenate(parts, 1)[:, :-GAP_PX]


def show(*names: str) -> Picture:
    """Show Blender images or picture files side by side, by name."""
    loaded = [bpy.data.images.load(name) for name in names if Path(name).is_file()]
    try:
        files = iter(loaded)
        wide = beside([pixels_of(next(files).name if Path(name).is_file() else name) for name in names])
    finally:
        for image in loaded:
            bpy.data.images.remove(image)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        save_png(path, wide)
        return Picture(path.read_bytes(), wide.shape[1], wide.shape[0])
