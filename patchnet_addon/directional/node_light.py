# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of nodes for kernels: luminance by viewing direction where faces differ (methods 7.2i), and light above white.

A plate thinner than a voxel has a lit and a dark side, a crease two walls, and a voxel of several layers shows the
outermost one. So such a node has, for each of its six faces (`surface/sides.py`), the luminance of the surface that
points to it, and its visible share. Along a direction d its luminance is the mean of the three faces that d runs
against, weighted by their shares and by |d| on their axis. Some faces show fronts of triangles, others backs; a ray
sees one side of a sheet, so only the kind of larger weight counts. The rest of an inner node's faces is open; the mean
of the node approximates the surface behind it. A leaf has no such rest, since rays hit it at its box. All other nodes
use their mean.

Light above white is the excess over the clamp of luminance to [0, 1], for the few nodes that have it (methods 7.1b).
Network, priorities and errors use the clamped luminance; a render adds the excess, so that lamps and sunlit walls keep
their brightness.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..surface.sides import FACES

_WORD = 64
_NONE, _GRAY = np.empty((0, FACES), np.uint8), np.empty((0, FACES, 2), np.uint8)


class VoxelSides(NamedTuple):
    """Sides of s of an octree's n nodes.

    bits: (ceil(n / 64),) uint64, nodes that have them. ranks: (ceil(n / 64),) uint32, number of such nodes before each
    word. light: (s, 6) uint8, roots of luminances, 255 = 1. share: (s, 6) uint8, visible share of each, of leaves over
    the largest, 255 = 1; odd where that is mostly backs of triangles. inner: (s,) bool, nodes with children.
    chroma: (s, 6, 2) uint8 as that of nodes, (0, 6, 2) without colour.
    """

    bits: np.ndarray
    ranks: np.ndarray
    light: np.ndarray
    share: np.ndarray
    inner: np.ndarray
    chroma: np.ndarray


NO_SIDES = VoxelSides(np.empty(0, np.uint64), np.empty(0, np.uint32), _NONE, _NONE, np.empty(0, np.bool_), _GRAY)


class HdrHighlights(NamedTuple):
    """Light above white of b nodes in the form of kernels.

    bits, ranks: nodes that have some, as in `VoxelSides`. colors: (b, 3) float32, linear and exposed, to be added to
    the node's colour.
    """

    bits: np.ndarray
    ranks: np.ndarray
    colors: np.ndarray


NO_HIGHLIGHTS = HdrHighlights(np.empty(0, np.uint64), np.empty(0, np.uint32), np.empty((0, 3), np.float32))


class NodeLight(NamedTuple):
    """Luminance (n,) uint16 of nodes, 65535 = 1, and their sides: an octree's light for kernels."""

    luminance: np.ndarray
    sides: VoxelSides


def sides_of(
    nodes: np.ndarray, child_mask: np.ndarray, light: np.ndarray, share: np.ndarray, chroma: np.ndarray | None
) -> VoxelSides:
    """Sides of ascending nodes (s,) of an octree with child masks (n,), for kernels."""
    if not len(nodes):
        return NO_SIDES
    hue = _GRAY if chroma is None else chroma.reshape(-1, FACES, 2)
    return VoxelSides(*marked(nodes, len(child_mask)), light, share, child_mask[nodes] != 0, hue)


def marked(nodes: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Bits (count / 64,) uint64 of ascending nodes (s,) among `count`, and the number (count / 64,) uint32 of these
    before each word.
    """
    bits = np.zeros(-(-count // _WORD) * 8, np.uint8)
    np.bitwise_or.at(bits, nodes >> 3, (1 << (nodes & 7)).astype(np.uint8))
    words = bits.view("<u8").astype(np.uint64)
    return words, np.searchsorted(nodes, np.arange(len(words), dtype=np.int64) * _WORD).astype(np.uint32)
