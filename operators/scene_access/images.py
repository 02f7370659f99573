# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays as Blender images and as image files, and the names of a view's pictures.

Pictures are (H, W), (H, W, 3), or (H, W, 4) with straight alpha, float32, row 0 at the bottom as Blender stores them.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from .own import OWNER

# Pictures of a view, each a file and a Blender image, in the order of the panel.
PICTURES = ("preview", "predicted", "heatmap", "overlay", "refined", "reference", "error")
OF_REFERENCE = ("reference", "error")  # only of views with a reference
PRIORITY_NAME = "priority.exr"
_DEPTHS_WITH_ALPHA = (32, 128)  # bits of a pixel, bytes and floats
VIEW_TRANSFORM = "Standard"  # of pictures of light; heatmaps and errors are computed from it


def unlike_view(scene: bpy.types.Scene) -> str:
    """Sentence about the view transform of pictures if it differs from the scene's, else ""."""
    view = scene.view_settings
    plain = view.look == "None" and (view.exposure, view.gamma, view.use_curve_mapping) == (0.0, 1.0, False)
    if view.view_transform == VIEW_TRANSFORM and plain:
        return ""
    shown = f"{view.view_transform} with its settings" if not plain else view.view_transform
    return f"Pictures are {VIEW_TRANSFORM}, F12 is {shown}"


def show_image(name: str, picture: np.ndarray, *, raw: bool = False) -> bpy.types.Image:
    """Create or update the result image `name`; `raw`: float values (Non-Color) instead of encoded colours.

    A user's image of this name is left alone. The pixels are packed, and the image has a fake user, so that all
    pictures are saved with the file, and closing Blender does not ask about them.
    """
    height, width = picture.shape[:2]
    image = next((item for item in bpy.data.images if item.get(OWNER) == name), None)
    alpha = _has_alpha(picture)
    if image is not None and (image.is_float != raw or (image.depth in _DEPTHS_WITH_ALPHA) != alpha):
        bpy.data.images.remove(image)
        image = None
    if image is None:
        image = bpy.data.images.new(name, width, height, alpha=alpha, float_buffer=raw, is_data=raw)
        image[OWNER] = name
        image.use_fake_user = True
    if tuple(image.size) != (width, height):
        image.scale(width, height)
    image.pixels.foreach_set(_rgba(picture))
    image.update()
    image.pack()
    return image


def drop_image(name: str) -> None:
    """Remove the result image `name`, if there is one."""
    for image in [item for item in bpy.data.images if item.get(OWNER) == name]:
        bpy.data.images.remove(image)


def free_copies(image: bpy.types.Image) -> None:
    """Free the pixels of a packed image in memory and on the graphics card; Blender reloads them when needed.

    Painted pixels that were not packed stay.
    """
    image.gl_free()
    if image.packed_file is not None and not image.is_dirty:
        image.buffers_free()


def save_png(path: Path, picture: np.ndarray) -> None:
    """Write encoded colours in [0, 1] as an 8-bit PNG, atomically; raises PatchNetError if that fails."""
    _save(path, picture, "PNG", raw=False)


def save_exr(path: Path, picture: np.ndarray) -> None:
    """Write raw values as a single-layer 32-bit EXR, atomically; raises PatchNetError if that fails."""
    _save(path, picture, "OPEN_EXR", raw=True)


def _save(path: Path, picture: np.ndarray, file_format: str, *, raw: bool) -> None:
    height, width = picture.shape[:2]
    temporary = path.with_name(f".{secrets.token_hex(4)}.{path.name}")
    image = bpy.data.images.new(path.name, width, height, alpha=_has_alpha(picture), float_buffer=raw, is_data=raw)
    try:
        image.pixels.foreach_set(_rgba(picture))
        image.file_format = file_format
        image.filepath_raw = str(temporary)
        image.save()
        os.replace(temporary, path)
    except (OSError, RuntimeError) as cause:
        reason = str(cause).strip().splitlines()[0].removeprefix("Error: ")
        raise PatchNetError(f"{path} cannot be written ({reason}): choose another folder or make room") from cause
    finally:
        bpy.data.images.remove(image)
        temporary.unlink(missing_ok=True)


def _rgba(picture: np.ndarray) -> np.ndarray:
    """(H * W * 4,) float32, opaque unless the picture has alpha."""
    height, width = picture.shape[:2]
    pixels = np.ones((height, width, 4), np.float32)
    channels = 4 if _has_alpha(picture) else 3
    pixels[..., :channels] = picture if picture.ndim == 3 else picture[..., None]
    return pixels.ravel()


def _has_alpha(picture: np.ndarray) -> bool:
    return picture.ndim == 3 and picture.shape[-1] == 4
