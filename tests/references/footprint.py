# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of `footprint`: cut an outline on a texture by every square on its own."""

from __future__ import annotations

import itertools

import numpy as np

from patchnet.patchnet_addon.surface.footprint import CUT_PARTS, MAX_SQUARES, SMALL, SOFT_PARTS
from patchnet.patchnet_addon.surface.textures import CUT_SAMPLES
from patchnet.tests.references.clip import area_and_centroid, half_space


def wrapped_reference(index: np.ndarray, size: int, wrap: str) -> tuple[np.ndarray, np.ndarray]:
    """Texels of indices (n,) by the texture's wrap mode, and whether there is one."""
    inside = (index >= 0) & (index < size)
    everywhere = np.ones_like(inside)
    if wrap in ("EXTEND", "CLIP", "BLACK"):
        return np.clip(index, 0, size - 1), everywhere if wrap == "EXTEND" else inside
    if wrap == "MIRROR":
        index = index % (2 * size)
        return np.where(index < size, index, 2 * size - 1 - index), everywhere
    return index % size, everywhere


def bilinear_reference(texels: np.ndarray, points: np.ndarray, wrap: str) -> np.ndarray:
    """Values (n, C) of a raster (h, w, C) at points (n, 2) in units of the texture."""
    height, width, channels = texels.shape
    x, y = points[:, 0] * width - 0.5, points[:, 1] * height - 0.5
    total = np.zeros((len(points), channels))
    for dy, dx in itertools.product((0, 1), repeat=2):
        column, there_x = wrapped_reference(np.floor(x).astype(int) + dx, width, wrap)
        row, there_y = wrapped_reference(np.floor(y).astype(int) + dy, height, wrap)
        weight = (1 - abs(x - np.floor(x) - dx)) * (1 - abs(y - np.floor(y) - dy)) * there_x * there_y
        total += weight[:, None] * texels[row, column]
    return total


def footprint_reference(
    levels: list[np.ndarray], outline: np.ndarray, wrap: str, threshold: float | None
) -> tuple[float | None, float]:
    """Means of opacity * luminance (None where opacity is even), and of opacity, over a convex outline (n, 2).

    levels: (h, w, 2) float32, finest first, of which only those after the first are cut.
    """
    soft = threshold is None
    if soft and (np.ptp(outline, axis=0) * levels[0].shape[1::-1]).max() <= SMALL:
        value = bilinear_reference(levels[0], area_and_centroid(outline)[1][None], wrap)[0]
        return float(value[0]), float(value[1])
    parts = SOFT_PARTS if soft else CUT_PARTS
    rasters = [(0, parts >> shift) for shift in range(parts.bit_length())] + [(i, 0) for i in range(1, len(levels))]
    for level, part in rasters:
        size = np.array(levels[level].shape[1::-1]) * max(part, 1)  # columns, lines
        first, last = np.floor(outline.min(axis=0) * size), np.floor(outline.max(axis=0) * size)
        if wrap in ("EXTEND", "CLIP"):
            margin = max(part, 1)
            first, last = (np.clip(each, -margin, size + margin - 1) for each in (first, last))
        if np.prod(last - first + 1) <= MAX_SQUARES:
            break
    else:
        value = _cut(levels[-1].reshape(1, 2), threshold if len(levels) == 1 else None)[0]
        return float(value[0]), float(value[1])
    values = _cut(_texels_around(levels[level], outline, first, last, part, wrap), threshold if part else None)
    if np.ptp(values[:, 1]) <= 1e-6:
        return None, float(values[:, 1].max())
    total = np.zeros(3)
    for x, y in itertools.product(*(range(int(a), int(b) + 1) for a, b in zip(first, last, strict=True))):
        area = _area_in_square(outline * size, (x, y), first, last)
        value = _square(levels[level], (x, y), size, part, wrap, threshold)
        total += area * np.array([1.0, *value])
    return float(total[1] / total[0]), float(total[2] / total[0])


def _texels_around(
    texels: np.ndarray, outline: np.ndarray, first: np.ndarray, last: np.ndarray, part: int, wrap: str
) -> np.ndarray:
    """Texels (n, 2) that an outline's values may come from."""
    size = np.array(texels.shape[1::-1])
    if part > 0:
        first, last = (np.floor(edge * size - 0.5) for edge in (outline.min(axis=0), outline.max(axis=0)))
        last = last + 1
    x, y = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(first, last, strict=True)))
    return bilinear_reference(texels, (np.column_stack([x.ravel(), y.ravel()]) + 0.5) / size, wrap)


def _area_in_square(outline: np.ndarray, square: tuple[int, int], first: np.ndarray, last: np.ndarray) -> float:
    """Area that an outline shares with a square; the outermost squares are open outwards."""
    polygon = [(point, point) for point in outline]
    for axis in range(2):
        if square[axis] > first[axis]:
            polygon = half_space(polygon, axis, square[axis], +1.0)
        if square[axis] < last[axis]:
            polygon = half_space(polygon, axis, square[axis] + 1, -1.0)
    return area_and_centroid(np.array([point for point, _ in polygon]))[0]


def _square(
    texels: np.ndarray, at: tuple[int, int], size: np.ndarray, part: int, wrap: str, threshold: float | None
) -> np.ndarray:
    """Value (2,) of one square: a texel, or the mean of samples in a part of a texel of the finest level."""
    if part == 0 or threshold is None:
        side, cut = 1, None
    else:
        side, cut = max(CUT_SAMPLES // part, 2), threshold
    steps = (np.arange(side) + 0.5) / side
    points = np.stack(np.meshgrid(at[0] + steps, at[1] + steps), axis=-1).reshape(-1, 2) / size
    return _cut(bilinear_reference(texels, points, wrap), cut).mean(axis=0)


def _cut(values: np.ndarray, threshold: float | None) -> np.ndarray:
    """Values (n, 2) with opacity 0 or 1."""
    if threshold is None:
        return values
    kept = (values[:, 1] >= threshold) & (values[:, 1] > 0)
    luminance = values[:, 0] / np.where(kept, values[:, 1], 1.0)
    return np.stack([np.where(kept, luminance, 0.0), kept], axis=1)
