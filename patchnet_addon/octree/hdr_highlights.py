# SPDX-License-Identifier: GPL-3.0-or-later
"""Light above white: the excess over the clamp of luminance to [0, 1], for the few nodes that have it (methods 7.1b).

Network, priorities and errors use the clamped luminance; a render adds the excess, so that lamps and sunlit walls keep
their brightness.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..surface.chroma import REC709, decoded_colors

_POPCOUNT = np.array([value.bit_count() for value in range(256)], np.int64)
_LEAST = 1.0 / 65535.0  # least stored excess luminance, the step of luminance itself


class HdrHighlights(NamedTuple):
    """Light above white of b nodes in the form of kernels.

    bits, ranks: nodes that have some, as in `Sides`. colors: (b, 3) float32, linear and exposed, to be added to the
    node's colour.
    """

    bits: np.ndarray
    ranks: np.ndarray
    colors: np.ndarray


NO_HIGHLIGHTS = HdrHighlights(np.empty(0, np.uint64), np.empty(0, np.uint32), np.empty((0, 3), np.float32))


def light_hdr_highlights(
    masks: Sequence[np.ndarray],
    areas: Sequence[np.ndarray],
    light: Sequence[np.ndarray],
    hues: Sequence[np.ndarray],
    exposure: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (b,) uint32, ascending, and colours (b, 3) float32 above white, of leaves and their means.

    All by level, coarse first: child masks (n,) and areas (n,) of its nodes, luminance (l,) before exposure and chroma
    (l, 2) of its leaves; `hues` is empty without colour.
    """
    first = np.cumsum([0, *(len(mask) for mask in masks)])
    nodes, colors = [], []
    index, own = np.empty(0, np.int64), np.empty((0, 3))  # of one level, within it
    for level in range(len(masks) - 1, -1, -1):
        mask = masks[level]
        inner, inner_colors = _means(mask, areas[level + 1], index, own) if len(index) else (index, own)
        leaf = np.flatnonzero(light[level] * exposure > 1.0)
        above = light[level][leaf] * exposure - 1.0
        hue = hues[level].reshape(-1, 2)[leaf] if len(hues) else None
        leaf_colors = np.repeat(above[:, None], 3, axis=1) if hue is None else decoded_colors(above, hue)
        leaf = np.flatnonzero(mask == 0)[leaf] if len(light[level]) < len(mask) else leaf
        order = np.argsort(np.concatenate([leaf, inner]))
        index = np.concatenate([leaf, inner])[order]
        own = np.concatenate([leaf_colors, inner_colors])[order]
        kept = own @ REC709.astype(np.float64) >= _LEAST
        nodes.append((index[kept] + first[level]).astype(np.uint32))
        colors.append(own[kept].astype(np.float32))
    return np.concatenate(nodes[::-1]), np.concatenate(colors[::-1])


def _means(mask: np.ndarray, area: np.ndarray, index: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (p,) of a level with children that have light above white, and its area-weighted means (p, 3) over them.

    mask: (n,) of the level. area: (c,) of the level below; index, own: its children (k,) with such light (k, 3).
    """
    counts = _POPCOUNT[mask]
    ends = np.cumsum(counts)
    parents, inverse = np.unique(np.searchsorted(ends, index, side="right"), return_inverse=True)
    child, count = ends[parents] - counts[parents], counts[parents]
    total = np.zeros(len(parents))
    for octant in range(8):
        there = octant < count
        total[there] += area[child[there] + octant]
    sums = [np.bincount(inverse.reshape(-1), area[index] * own[:, channel], len(parents)) for channel in range(3)]
    return parents, np.stack(sums, axis=1) / total[:, None]
