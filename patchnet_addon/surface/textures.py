# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour and opacity of textured surfaces, averaged over the size of a fragment.

Each textured material has a pyramid of box-filtered means. A fragment reads the level whose texels are about as large
as the fragment is on the texture, so that coarse voxels get means instead of single texels. Opacity that a threshold
cuts out is cut on the finest level, before it is averaged, so that coverage stays right; luminance is averaged with
opacity as its weight, so that what is cut away does not colour what stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .mesh import Material, Texture

REC709 = np.array([0.2126, 0.7152, 0.0722], np.float32)
REPEAT, EXTEND, MIRROR, CLIP = range(4)
EXTENSIONS = {"REPEAT": REPEAT, "EXTEND": EXTEND, "MIRROR": MIRROR, "CLIP": CLIP}
CUT_SAMPLES = 4  # along a texel that a threshold cuts
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Linear Rec. 709 luminance (...) float32 of colours (..., 3)."""
    return np.asarray(rgb, np.float32) @ REC709


@dataclass(frozen=True, eq=False)
class TextureTable:
    """Table of all materials as flat arrays for the kernels; M materials, K pyramids, V levels altogether.

    texels: (N, 2) float32, opacity times luminance, and opacity. On level 0 opacity is not cut yet.
    level_offset, level_height, level_width: (V,) int64.
    pyramid_first: (K,) int64 first of its levels. pyramid_levels: (K,) int64.
    pyramid_extension: (K,) int64. pyramid_transform: (K, 2, 3) float64. pyramid_solid: (K,) bool, opaque everywhere.
    material_pyramid: (M,) int64, -1 for no texture. material_luminance: (M,) float32, without texture.
    material_color: (M,) int64, pyramid of the base colour where that is laid out unlike the opacity, otherwise -1.
    material_opacity: (M,) float32, a factor on the texture's. material_threshold: (M,) float32, NaN for none.
    material_emission: (M,) float32.
    Only with colour: colors (N, 3) float32, opacity times red, green and blue, opacity not cut on level 0;
    material_base and material_glow (M, 3) float32, the colours of material_luminance and material_emission.
    """

    texels: np.ndarray
    level_offset: np.ndarray
    level_height: np.ndarray
    level_width: np.ndarray
    pyramid_first: np.ndarray
    pyramid_levels: np.ndarray
    pyramid_extension: np.ndarray
    pyramid_transform: np.ndarray
    pyramid_solid: np.ndarray
    material_pyramid: np.ndarray
    material_color: np.ndarray
    material_luminance: np.ndarray
    material_opacity: np.ndarray
    material_threshold: np.ndarray
    material_emission: np.ndarray
    colors: np.ndarray
    material_base: np.ndarray
    material_glow: np.ndarray

    @classmethod
    def from_materials(cls, materials: tuple[Material, ...], *, color: bool = False) -> TextureTable:
        """Pyramids of all textured materials, in colour if wanted; equal ones are shared."""
        pyramids: dict[tuple[object, ...], int] = {}
        levels: list[list[np.ndarray]] = []
        styles: list[Texture] = []

        def pyramid_of(material: Material) -> int:
            main = material.base_texture or material.alpha_texture
            if main is None:
                return -1
            key = _pyramid_key(material)
            if key not in pyramids:
                pyramids[key] = len(levels)
                levels.append(_pyramid(material, color))
                styles.append(main)
            return pyramids[key]

        parts = [_parts(material) for material in materials]
        index = np.array([pyramid_of(surface) for surface, _ in parts], np.int64)
        other_color = np.array([-1 if other is None else pyramid_of(other) for _, other in parts], np.int64)
        flat = [level for pyramid in levels for level in pyramid]
        counts = np.array([len(pyramid) for pyramid in levels], np.int64)
        sizes = np.array([level.shape[0] * level.shape[1] for level in flat], np.int64)
        return cls(
            texels=_joined(flat, slice(0, 2)),
            level_offset=np.cumsum(sizes) - sizes,
            level_height=np.array([level.shape[0] for level in flat], np.int64),
            level_width=np.array([level.shape[1] for level in flat], np.int64),
            pyramid_first=np.cumsum(counts) - counts,
            pyramid_levels=counts,
            pyramid_extension=np.array([EXTENSIONS[style.extension] for style in styles], np.int64),
            pyramid_transform=np.array([style.transform or _IDENTITY for style in styles], np.float64).reshape(
                -1, 2, 3
            ),
            pyramid_solid=np.array(
                [
                    style.extension != "CLIP" and bool(pyramid[0][..., 1].min() >= 1.0)
                    for style, pyramid in zip(styles, levels, strict=True)
                ],
                np.bool_,
            ),
            material_pyramid=index,
            material_color=other_color,
            material_luminance=luminance(np.array([m.base_color for m in materials])),
            material_opacity=np.array([m.alpha for m in materials], np.float32),
            material_threshold=np.array(
                [np.nan if m.alpha_threshold is None else m.alpha_threshold for m in materials], np.float32
            ),
            material_emission=luminance(np.array([m.emission for m in materials])),
            colors=_joined(flat if color else [], slice(2, 5)),
            material_base=np.array([m.base_color for m in materials], np.float32),
            material_glow=np.array([m.emission for m in materials], np.float32),
        )


def _joined(levels: list[np.ndarray], channels: slice) -> np.ndarray:
    """Concatenate some channels of all levels (h, w, C), one texel after the other; black where there are none."""
    parts = [level[..., channels].reshape(-1, channels.stop - channels.start) for level in levels]
    return np.concatenate(parts) if parts else np.zeros((1, channels.stop - channels.start), np.float32)


def _style(texture: Texture) -> tuple[object, ...]:
    return texture.extension, texture.transform or _IDENTITY


def _parts(material: Material) -> tuple[Material, Material | None]:
    """Split a material into its opacity, and its base colour if that texture lies otherwise on the surface."""
    base, alpha = material.base_texture, material.alpha_texture
    if base is None or alpha is None or _style(base) == _style(alpha):
        return material, None
    return replace(material, base_texture=None), replace(material, alpha_texture=None, alpha_threshold=None)


def _pyramid_key(material: Material) -> tuple[object, ...]:
    base, alpha = material.base_texture, material.alpha_texture
    style = _style(base or alpha)  # type: ignore[arg-type]
    factor = material.base_color
    threshold = None if material.alpha_threshold is None or alpha is None else material.alpha_threshold / material.alpha
    return base and id(base.pixels), alpha and id(alpha.pixels), style, factor, threshold


def _pyramid(material: Material, color: bool) -> list[np.ndarray]:
    """Levels (h, w, 2) float32, (h, w, 5) with colour, finest first, each half as large as the one before."""
    shine, opacity = _finest(material)
    hue = _finest_color(material, opacity.shape) if color else ()
    levels = [_weighed(shine, opacity, hue)]
    if material.alpha_threshold is not None and material.alpha_texture is not None:
        extension = (material.base_texture or material.alpha_texture).extension
        opacity = cut_coverage(opacity, material.alpha_threshold / max(material.alpha, 1e-6), extension)
    below = _weighed(shine, opacity, hue)
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
        shine = np.full(shape, luminance(factor), np.float32)
    else:
        shine = _resized(base.pixels @ (REC709 * factor), shape)
    opacity = np.ones(shape, np.float32) if alpha is None else _resized(alpha.pixels[..., 0], shape)
    return shine, opacity


def _finest_color(material: Material, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """Red, green and blue, each (h, w) float32, on a raster of that shape."""
    factor = np.asarray(material.base_color, np.float32)
    if material.base_texture is None:
        return tuple(np.full(shape, value, np.float32) for value in factor)
    return tuple(_resized(material.base_texture.pixels[..., channel] * factor[channel], shape) for channel in range(3))


def _weighed(shine: np.ndarray, opacity: np.ndarray, hue: tuple[np.ndarray, ...]) -> np.ndarray:
    """Channels (h, w, 2 or 5) of a level."""
    return np.stack([shine * opacity, opacity, *(channel * opacity for channel in hue)], axis=-1)


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


def cut_coverage(opacity: np.ndarray, threshold: float, extension: str = "REPEAT") -> np.ndarray:
    """Share of each texel (h, w) on which bilinear opacity reaches the threshold, from CUT_SAMPLES^2 samples in it."""
    around = {"REPEAT": "wrap", "CLIP": "constant"}.get(extension, "edge")
    padded = np.pad(opacity, 1, mode=around)  # type: ignore[call-overload]
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
