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


def texels(picture: np.ndarray) -> np.ndarray:
    """Texels (H, W, 4) float32 of sRGB colours (H, W, 3), opaque, or with straight alpha (H, W, 4)."""
    opaque = np.ones((*picture.shape[:2], 4 - picture.shape[-1]), np.float32)  # no column where there is alpha
    return np.concatenate([picture, opaque], axis=-1, dtype=np.float32)


def uploaded(picture: np.ndarray) -> Any:
    """Upload sRGB colours as a texture, see `texels`."""
    import gpu

    height, width = picture.shape[:2]
    pixels = texels(picture)
    data = gpu.types.Buffer("FLOAT", pixels.size, pixels.ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA8", data=data)
