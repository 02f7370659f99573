# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture cache on the graphics card: the pictures that were drawn last, and no more than a few."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np

from ..session.shown_view import ShownView

_MAX = 6  # two sides of a wipe in three editors
_textures: OrderedDict[tuple[Any, ...], Any] = OrderedDict()


def texture_of(view: ShownView, name: str, maximum: float, ramp: str) -> Any:
    """Texture (gpu.types.GPUTexture) of a view's picture, made when it is first drawn."""
    key = (view.number, name, *((maximum, ramp) if name not in view.looks else ()))
    if key not in _textures:
        _textures[key] = uploaded(view.picture(name, maximum, ramp))
        while len(_textures) > _MAX:
            _textures.popitem(last=False)
    _textures.move_to_end(key)
    return _textures[key]


def free_textures() -> None:
    """Give the graphics card its memory back."""
    _textures.clear()


def held() -> int:
    """Number of textures that are held."""
    return len(_textures)


def uploaded(picture: np.ndarray) -> Any:
    """Upload sRGB colours (H, W, 3) as a texture, one texel a pixel."""
    import gpu

    height, width = picture.shape[:2]
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = picture
    data = gpu.types.Buffer("FLOAT", pixels.size, pixels.ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA8", data=data)
