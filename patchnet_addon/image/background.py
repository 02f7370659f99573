# SPDX-License-Identifier: GPL-3.0-or-later
"""Background behind a picture's light: a colour, the world in each pixel's direction, or none (transparent film).

Light of surfaces is over black and premultiplied by alpha, the share of a pixel's rays that hit. Strategies and errors
use only that light (methods 8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..surface.textures import luminance
from ..tracing.camera import Camera
from .tone import gray, srgb_encode

BLACK = np.zeros(3, np.float32)


def over(light: np.ndarray, alpha: np.ndarray, background: np.ndarray, exposure: float) -> np.ndarray:
    """Light (P,) or (P, 3) float32, exposed, premultiplied by alpha (P,), over an unexposed background (3,), (P, 3)."""
    behind = np.float32(exposure) * np.broadcast_to(np.asarray(background, np.float32), (len(alpha), 3))
    if light.ndim == 1:
        return (light + (1.0 - alpha) * luminance(behind)).astype(np.float32)
    return (light + (1.0 - alpha)[:, None] * behind).astype(np.float32)


def encoded(light: np.ndarray, alpha: np.ndarray, background: np.ndarray | None, exposure: float) -> np.ndarray:
    """sRGB colours (P, 3) float32 in [0, 1] of light over its background; (P, 4) with straight alpha without one."""
    if background is not None:
        light = over(light, alpha, background, exposure)
        return srgb_encode(light) if light.ndim == 2 else gray(light)
    share = np.clip(alpha, 0.0, 1.0).astype(np.float32)
    weight = share if light.ndim == 1 else share[:, None]
    straight = np.divide(light, weight, out=np.zeros_like(light, np.float32), where=weight > 0.0)
    return np.column_stack([srgb_encode(straight) if light.ndim == 2 else gray(straight), share])


def opaque(picture: np.ndarray) -> np.ndarray:
    """Picture (h, w, 3) of encoded colours; one with alpha (h, w, 4) is put over black."""
    return picture if picture.shape[-1] == 3 else picture[..., :3] * picture[..., 3:]


@dataclass(frozen=True, eq=False)
class Ground:
    """Background and exposure of a camera's picture."""

    camera: Camera
    background: np.ndarray | None
    exposure: float

    def picture(self, light: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """(H, W, 3) encoded colours of light (P,) or (P, 3) weighed by alpha (P,), or (H, W, 4) without background."""
        pixels = encoded(light, alpha, self.background, self.exposure)
        return pixels.reshape(self.camera.height_px, self.camera.width_px, -1)
