# SPDX-License-Identifier: GPL-3.0-or-later
"""Terms that sockets of a shader tree evaluate to: a constant times, or affine in, one image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...patchnet_addon.surface.chroma import BLUE, GREEN, RED

REC709 = (RED, GREEN, BLUE)
Rgb = tuple[float, float, float]
WHITE: Rgb = (1.0, 1.0, 1.0)
MISSING: Rgb = (1.0, 0.0, 1.0)  # color of a missing image in Cycles
Transform = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class TextureUse:
    """Image and its mapping: uv' = transform (2, 3) of (u, v, 1); wrap: the node's `extension`.

    uv_map: name of the UV map or attribute, "" for the one that renders. closest: texels are squares of one colour.
    """

    image: bpy.types.Image
    wrap: str = "REPEAT"
    transform: Transform | None = None
    uv_map: str = ""
    closest: bool = False


@dataclass(frozen=True)
class ColorTerm:
    """Colour term: factor * texture, or factor alone."""

    factor: Rgb = WHITE
    texture: TextureUse | None = None

    def scaled(self, factor: Rgb) -> ColorTerm:
        """Scale this colour by a constant one."""
        r, g, b = (one * other for one, other in zip(self.factor, factor, strict=True))
        return replace(self, factor=(r, g, b))


@dataclass(frozen=True)
class NumberTerm:
    """Number term: scale * channel of a texture + offset, or offset alone; 1 or 0 by `threshold` if there is one."""

    offset: float = 1.0
    scale: float = 0.0
    texture: TextureUse | None = None
    channel: str = "A"
    threshold: float | None = None

    @property
    def constant(self) -> bool:
        """Return whether it has no texture."""
        return self.texture is None

    def affine(self, scale: float, offset: float) -> NumberTerm:
        """Affine map of this term: scale * this + offset; after a threshold only the complement is possible."""
        if self.threshold is not None:
            if (scale, offset) == (1.0, 0.0):
                return self
            if (scale, offset) == (-1.0, 1.0):
                turned = replace(self, threshold=None).affine(-1.0, 1.0)
                return replace(turned, threshold=1.0 - self.threshold)
            raise NotUnderstoodError("arithmetic after an alpha threshold")
        return replace(self, offset=scale * self.offset + offset, scale=scale * self.scale)


class NotUnderstoodError(Exception):
    """Unsupported part of a shader tree; the message is a noun phrase."""


def rgb(value: object) -> Rgb:
    """Socket's value as a colour."""
    if isinstance(value, float | int):
        return (float(value),) * 3
    r, g, b = (float(each) for each in list(value)[:3])  # type: ignore[call-overload]
    return r, g, b


def number(value: object) -> float:
    """Socket's value as a number; a colour counts by its luminance."""
    if isinstance(value, float | int):
        return float(value)
    return float(np.dot(rgb(value), REC709))
