# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colour and opacity where a ray meets a triangle, over the ray's footprint (methods 7.2k)."""

from __future__ import annotations

import math

import numpy as np

from ..runtime.kernels import device
from .hit_textures import DETAIL, MATERIAL_OF, TOP, U, V
from .texels import MipChain, mip_level, on_texture, texels_around
from .textures import BLACK, LEAST_BASE, MIRROR, REPEAT


@device
def is_clear(textures, uvs, row, side):
    """Return whether one side of a triangle is see-through, 0 the front and 1 the back. uvs: as in `Pieces`."""
    return textures.materials[np.int64(uvs[row, MATERIAL_OF])].clear_side == side


@device
def base_at_hit(textures, uvs, row, one, two, pixel):
    """Base colour, red, green and blue, and opacity of a point of a triangle, means over a footprint.

    uvs: (t, 8) as in `Pieces`. one, two: weights of the last two corners. pixel: side of the footprint. Colour is
    1 where it does not multiply light.
    """
    material = textures.materials[np.int64(uvs[row, MATERIAL_OF])]
    red, green, blue = float(material.red), float(material.green), float(material.blue)
    opacity = float(material.opacity)
    if material.chain >= 0:
        s, r = _at(uvs, row, U, one, two), _at(uvs, row, V, one, two)
        mantissa, exponent = math.frexp(pixel)
        level = uvs[row, DETAIL] + exponent + 2.0 * mantissa - 2.0  # nearly the logarithm
        threshold = float(material.threshold)
        red, green, blue, there = _mean(textures, material.chain, s, r, level, threshold / opacity)
        opacity = there if threshold == threshold else opacity * there
        if material.color_chain >= 0:  # the colour has its own layout
            red, green, blue, _ = _mean(textures, material.color_chain, s, r, level, math.nan)
    if not material.reflects:
        return 1.0, 1.0, 1.0, opacity
    least = float(LEAST_BASE)
    return max(red, least), max(green, least), max(blue, least), opacity


@device
def _at(uvs, row, axis, one, two):
    """UV coordinate on an axis of a point of a triangle."""
    return (1.0 - one - two) * uvs[row, axis] + one * uvs[row, 2 + axis] + two * uvs[row, 4 + axis]


@device
def _mean(textures, k, s, r, level, threshold):
    """Colour and opacity of a chain's nearest level. level: for a chain of one texel."""
    own = textures.chains[k]
    u, v = on_texture(own.transform, s, r)
    chain = MipChain(int(own.first), int(own.level_count), int(own.wrap))
    step = int(min(max(level + own.detail + 0.5, 0.0), chain.level_count - 1.0))
    if chain.wrap != REPEAT and chain.wrap != MIRROR and not (0.0 <= u <= 1.0 and 0.0 <= v <= 1.0):
        step = 0  # coarse levels hold the whole image, and there is only its border
    red, green, blue, opacity = _bilinear(textures.texels, mip_level(textures.levels, chain, step), u, v)
    if opacity <= 1e-6:
        return 0.0, 0.0, 0.0, 0.0
    scale = 1.0 / opacity
    if step == 0 and threshold == threshold:  # the finest level keeps its opacity uncut
        opacity = 1.0 if opacity >= threshold else 0.0
    return scale * red, scale * green, scale * blue, min(opacity, 1.0)


@device
def _bilinear(texels, level, u, v):
    """Opacity times colour, and opacity, at (u, v) in units of the texture."""
    red = green = blue = opacity = 0.0
    around, weights = texels_around(level, u, v)
    for corner in range(4):
        index, weight = around[corner], weights[corner]
        texel = np.int64(255 << 24) if level.wrap == BLACK else np.int64(0)
        if index >= 0:
            texel = np.int64(texels[index])
        r, g, b = texel & 255, texel >> 8 & 255, texel >> 16 & 255
        red += weight * (r * r)
        green += weight * (g * g)
        blue += weight * (b * b)
        opacity += weight * (texel >> 24)
    return red / TOP**2, green / TOP**2, blue / TOP**2, opacity / TOP
