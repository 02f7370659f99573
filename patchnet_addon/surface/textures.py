# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour and opacity of textured surfaces, averaged over the size of a fragment.

Each textured material has a mip chain of box-filtered means. A fragment reads the level whose texels are about its size
on the texture, so that coarse voxels get means instead of single texels. Thresholds on opacity apply to the finest
level, before averaging, so that coverage stays right; luminance is averaged with opacity as weight, so that cut-out
texels do not affect the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from .chroma import REC709
from .mesh import Material, Texture

REPEAT, EXTEND, MIRROR, CLIP, BLACK = range(5)
# Outside of a clipped image, opacity is 0 if the image holds opacity; an image of colour only is black.
WRAP_MODES = {"REPEAT": REPEAT, "EXTEND": EXTEND, "MIRROR": MIRROR, "CLIP": CLIP, "BLACK": BLACK}
# A bilinear lookup in a box-filtered level has the variance of a box sqrt(3) times as wide as its texels.
LEVEL_BIAS = 0.5 * math.log2(3.0)
CUT_SAMPLES = 4  # along a texel cut by a threshold
LEAST_BASE = np.float32(0.02)  # of a base colour that light is divided by, and multiplied with again
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Linear Rec. 709 luminance (...) float32 of colours (..., 3)."""
    return np.asarray(rgb, np.float32) @ REC709


class MipChains(NamedTuple):
    """Mip chains of textures for kernels: K chains, V levels in total, N texels in sequence.

    texels: (N, 2) float32, opacity times luminance, and opacity. On level 0 opacity is not cut yet.
    colors: (N, 3) float32, opacity times red, green and blue, opacity not cut on level 0; only with colour.
    levels: (V, 3) int64, first texel, height and width of each level.
    first: (K,) int64 first of a chain's levels, finest first. level_count: (K,) int64 their number.
    wrap: (K,) int64 of `WRAP_MODES`. transform: (K, 2, 3) float64. solid: (K,) bool, opaque everywhere.
    """

    texels: np.ndarray
    colors: np.ndarray
    levels: np.ndarray
    first: np.ndarray
    level_count: np.ndarray
    wrap: np.ndarray
    transform: np.ndarray
    solid: np.ndarray


class MaterialTable(NamedTuple):
    """M materials for kernels.

    chain: (M,) int64 mip chain, -1 for no texture.
    color_chain: (M,) int64, that of the base colour if its layout differs from the opacity's, otherwise -1.
    luminance: (M,) float32, without texture. base_color: (M, 3) float32, the colour of that luminance.
    opacity: (M,) float32, a factor on the texture's. threshold: (M,) float32, NaN for none.
    clear_side: (M,) int64, see-through side, -1 for none.
    emission: (M,) float32, beside a base colour. glow: (M, 3) float32, the colour of that luminance.
    """

    chain: np.ndarray
    color_chain: np.ndarray
    luminance: np.ndarray
    base_color: np.ndarray
    opacity: np.ndarray
    threshold: np.ndarray
    clear_side: np.ndarray
    emission: np.ndarray
    glow: np.ndarray


@dataclass(frozen=True, eq=False)
class TextureTable:
    """Table of all materials and their mip chains, as flat arrays for the kernels."""

    chains: MipChains
    materials: MaterialTable

    @classmethod
    def from_materials(cls, materials: tuple[Material, ...], *, color: bool = False) -> TextureTable:
        """Mip chains of all textured materials, in colour if wanted; equal chains are shared."""
        numbers: dict[tuple[object, ...], int] = {}
        levels: list[list[np.ndarray]] = []
        styles: list[Texture] = []

        def chain_of(material: Material) -> int:
            main = material.base_texture or material.alpha_texture
            if main is None:
                return -1
            key = _chain_key(material)
            if key not in numbers:
                numbers[key] = len(levels)
                levels.append(_mip_chain(material, color))
                black = main.wrap == "CLIP" and material.alpha_texture is None
                styles.append(replace(main, wrap="BLACK") if black else main)
            return numbers[key]

        parts = [_parts(material) for material in materials]
        chain = np.array([chain_of(surface) for surface, _ in parts], np.int64)
        color_chain = np.array([-1 if other is None else chain_of(other) for _, other in parts], np.int64)
        glow = np.array([(0.0,) * 3 if m.glows else m.emission for m in materials], np.float32).reshape(-1, 3)
        table = MaterialTable(
            chain=chain,
            color_chain=color_chain,
            luminance=luminance(np.array([m.base_color for m in materials])),
            base_color=np.array([m.base_color for m in materials], np.float32),
            opacity=np.array([m.alpha for m in materials], np.float32),
            threshold=np.array(
                [np.nan if m.alpha_threshold is None else m.alpha_threshold for m in materials], np.float32
            ),
            clear_side=np.array([-1 if m.clear_side is None else m.clear_side for m in materials], np.int64),
            emission=luminance(glow),
            glow=glow,
        )
        return cls(_joined_chains(levels, styles, color), table)


def _joined_chains(chains: list[list[np.ndarray]], styles: list[Texture], color: bool) -> MipChains:
    """Mip chains with levels (h, w, 2 or 5), mapped like the textures `styles`."""
    flat = [level for chain in chains for level in chain]
    counts = np.array([len(chain) for chain in chains], np.int64)
    sizes = np.array([level.shape[:2] for level in flat], np.int64).reshape(-1, 2)
    ends = np.cumsum(sizes.prod(axis=1))
    solid = [
        style.wrap != "CLIP" and bool(chain[0][..., 1].min() >= 1.0)
        for style, chain in zip(styles, chains, strict=True)
    ]
    return MipChains(
        texels=_joined(flat, slice(0, 2)),
        colors=_joined(flat if color else [], slice(2, 5)),
        levels=np.column_stack([ends - sizes.prod(axis=1), sizes]),
        first=np.cumsum(counts) - counts,
        level_count=counts,
        wrap=np.array([WRAP_MODES[style.wrap] for style in styles], np.int64),
        transform=np.array([style.transform or _IDENTITY for style in styles], np.float64).reshape(-1, 2, 3),
        solid=np.array(solid, np.bool_),
    )


def _joined(levels: list[np.ndarray], channels: slice) -> np.ndarray:
    """Concatenate channels of all levels (h, w, C), texel by texel; black for missing ones."""
    parts = [level[..., channels].reshape(-1, channels.stop - channels.start) for level in levels]
    return np.concatenate(parts) if parts else np.zeros((1, channels.stop - channels.start), np.float32)


def _style(texture: Texture | None) -> tuple[object, ...]:
    return () if texture is None else (texture.wrap, texture.transform or _IDENTITY)


def _parts(material: Material) -> tuple[Material, Material | None]:
    """Split a material into its opacity, and its base colour if that texture is mapped differently."""
    base, alpha = material.base_texture, material.alpha_texture
    if base is None or alpha is None or _style(base) == _style(alpha):
        return material, None
    return replace(material, base_texture=None), replace(material, alpha_texture=None, alpha_threshold=None)


def _chain_key(material: Material) -> tuple[object, ...]:
    base, alpha = material.base_texture, material.alpha_texture
    style = _style(base or alpha)
    factor = material.base_color
    threshold = None if material.alpha_threshold is None or alpha is None else material.alpha_threshold / material.alpha
    return base and id(base.pixels), alpha and id(alpha.pixels), style, factor, threshold


def _mip_chain(material: Material, color: bool) -> list[np.ndarray]:
    """Levels (h, w, 2) float32, (h, w, 5) with colour, finest first, each half as large as the one before."""
    luminance, opacity = _finest(material)
    hue = _finest_color(material, opacity.shape) if color else ()
    levels = [_premultiplied(luminance, opacity, hue)]
    if material.alpha_threshold is not None and material.alpha_texture is not None:
        wrap = (material.base_texture or material.alpha_texture).wrap
        opacity = cut_coverage(opacity, material.alpha_threshold / max(material.alpha, 1e-6), wrap)
    below = _premultiplied(luminance, opacity, hue)
    while max(below.shape[:2]) > 1:
        below = _halved(_halved(below, 0), 1)
        levels.append(below)
    return levels


def _finest(material: Material) -> tuple[np.ndarray, np.ndarray]:
    """Luminance (h, w) and uncut opacity (h, w) float32 on the larger of the two textures' rasters."""
    base, alpha = material.base_texture, material.alpha_texture
    shape = tuple(np.max([texture.pixels.shape[:2] for texture in (base, alpha) if texture is not None], axis=0))
    factor = np.asarray(material.base_color, np.float32)
    if base is None:
        values = np.full(shape, luminance(factor), np.float32)
    else:
        values = _resized(base.pixels @ (REC709 * factor), shape)
    opacity = np.ones(shape, np.float32) if alpha is None else _resized(alpha.pixels[..., 0], shape)
    return values, opacity


def _finest_color(material: Material, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """Red, green and blue, each (h, w) float32, on a raster of that shape."""
    factor = np.asarray(material.base_color, np.float32)
    if material.base_texture is None:
        return tuple(np.full(shape, value, np.float32) for value in factor)
    return tuple(_resized(material.base_texture.pixels[..., channel] * factor[channel], shape) for channel in range(3))


def _premultiplied(luminance: np.ndarray, opacity: np.ndarray, hue: tuple[np.ndarray, ...]) -> np.ndarray:
    """Channels (h, w, 2 or 5) of a level: luminance and colour times opacity; opacity is the second channel."""
    return np.stack([luminance * opacity, opacity, *(channel * opacity for channel in hue)], axis=-1)


def _resized(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Bilinear enlargement of a raster (h, w)."""
    for axis, size in enumerate(shape):
        if values.shape[axis] != size:
            at = (np.arange(size) + 0.5) * values.shape[axis] / size - 0.5
            low = np.clip(np.floor(at).astype(int), 0, values.shape[axis] - 1)
            high = np.minimum(low + 1, values.shape[axis] - 1)
            weight = np.clip(at - low, 0.0, 1.0).reshape([-1 if each == axis else 1 for each in range(2)])
            values = np.take(values, low, axis) * (1 - weight) + np.take(values, high, axis) * weight
    return values.astype(np.float32)


def cut_coverage(opacity: np.ndarray, threshold: float, wrap: str = "REPEAT") -> np.ndarray:
    """Share of each texel (h, w) on which bilinear opacity reaches the threshold, from CUT_SAMPLES^2 samples in it."""
    around: Literal["wrap", "constant", "edge"] = (
        "wrap" if wrap == "REPEAT" else "constant" if wrap == "CLIP" else "edge"
    )
    padded = np.pad(opacity, 1, mode=around)
    total = np.zeros_like(opacity)
    offsets = (np.arange(CUT_SAMPLES, dtype=np.float32) + 0.5) / CUT_SAMPLES - 0.5
    for dy in offsets:
        near = slice(0, -2) if dy < 0 else slice(2, None)
        rows = (1 - abs(dy)) * padded[1:-1] + abs(dy) * padded[near]
        for dx in offsets:
            near = slice(0, -2) if dx < 0 else slice(2, None)
            total += (1 - abs(dx)) * rows[:, 1:-1] + abs(dx) * rows[:, near] >= threshold
    return total / np.float32(CUT_SAMPLES**2)


def _halved(values: np.ndarray, axis: int) -> np.ndarray:
    """Exact box means onto half as many texels along an axis; odd sizes share a texel between two."""
    size = values.shape[axis]
    if size == 1:
        return values
    half = size // 2
    values = np.moveaxis(values, axis, 0)
    if size % 2 == 0:
        result = 0.5 * (values[0::2] + values[1::2])
    else:
        # Source texel i covers [i, i + 1] of size; target j covers [j, j + 1] * size / half.
        j = np.arange(half, dtype=np.float32).reshape(-1, *[1] * (values.ndim - 1))
        weights = (half - j) / size, np.float32(half / size), (j + 1) / size
        result = weights[0] * values[0:-1:2] + weights[1] * values[1::2] + weights[2] * values[2::2]
    return np.ascontiguousarray(np.moveaxis(result.astype(np.float32), 0, axis))
