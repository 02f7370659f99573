# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance of the pixels of a view."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.sampling.importance import PixelRect, beside_hits, picture_weights
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.surface.chroma import REC709
from ..scene.render_geometry import render_geometry
from .painted import Importance

if TYPE_CHECKING:
    from .vertex_group import PaintedSurface


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


@dataclass(frozen=True, eq=False)
class Strokes:
    """Strokes that were painted, read once: from here on nothing asks Blender, so any thread may look weights up.

    One of `picture`, (h, w) float32 with row 0 at the bottom, and `surface`.
    """

    picture: np.ndarray | None = None
    surface: PaintedSurface | None = None

    def weights(self, grid: Grid, buffers: PixelBuffers, rect: PixelRect | None = None) -> Steps[np.ndarray]:
        """(P,) float32 in [0, 1] for the pixels of a view of an octree; `rect`: what an image is stretched over."""
        if self.surface is not None:
            from .vertex_group import vertex_group_weights

            weights = yield from vertex_group_weights(self.surface, grid, buffers)
            return beside_hits(buffers.picture(weights), buffers.picture(buffers.hit)).ravel()
        assert self.picture is not None
        return picture_weights(self.picture, buffers.height, buffers.width, rect)


def read_strokes(importance: Importance, scope: str, depsgraph: bpy.types.Depsgraph) -> Strokes:
    """Read what was painted in the open file.

    scope: which objects were voxelized. depsgraph: gets geometry as renders have it for the moment, unless it is a
    render's own graph. Raises SettingError if what was painted is not there.

    A render may call this in its own thread: it only reads, meshes of its own graph, and images the way Cycles does.
    """
    if importance.vertex_group:
        from .vertex_group import PaintedSurface

        with render_geometry(depsgraph):
            return Strokes(surface=PaintedSurface(depsgraph, scope, importance.vertex_group))
    file = importance.file
    return Strokes(picture=painted_image(importance.image) if file is None else painted_file(file))


def pixel_importance(importance: Importance, scope: str, grid: Grid, buffers: PixelBuffers) -> Steps[np.ndarray]:
    """(P,) float32 in [0, 1] for the pixels of a view of the open scene, as `read_strokes` finds them."""
    strokes = read_strokes(importance, scope, bpy.context.evaluated_depsgraph_get())
    return (yield from strokes.weights(grid, buffers))


def importance_key(importance: Importance | None) -> str:
    """Hash of what was painted, as a short text: frames made with other strokes are not those that would be made."""
    if importance is None:
        return ""
    digest = hashlib.blake2b(digest_size=16)
    if importance.vertex_group:
        from .vertex_group import group_weights

        for item in bpy.data.objects:
            if isinstance(item.data, bpy.types.Mesh) and importance.vertex_group in item.vertex_groups:
                digest.update(item.name_full.encode())
                digest.update(group_weights(item, item.data, importance.vertex_group).data)
    else:
        file = importance.file
        values = painted_image(importance.image) if file is None else painted_file(file)
        digest.update(repr(values.shape).encode() + np.ascontiguousarray(values, np.float32).data)
    return digest.hexdigest()
