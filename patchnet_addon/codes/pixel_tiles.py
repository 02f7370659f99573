# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiles of pixels for the decoder: codes and rays of hits, one feature per row (`network/compiled_layers.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..network.compiled_layers import DIRECTION, RATIO, TILE, UP
from ..network.kinds import CODE_SIZE
from ..runtime.kernels import device
from ..runtime.vectors import HALF_SCALE, add_product, load_halves, splat, store
from .coded_nodes import CodedNodes, coded_row
from .coded_octree import CodedOctree
from .corner_rows import corner_row

if TYPE_CHECKING:
    from ..tracing.render import Hits

MEAN_SIZE = 16  # of a mean written by `write_mean_code`: two vectors of eight numbers, which overlap in the code
assert 8 <= CODE_SIZE <= 16

_SCALE = np.float32(HALF_SCALE)


class CornerCodes(NamedTuple):
    """Codes and their index.

    halves: (C * 10,) int16, the bits of the half floats. nodes: of `CodedOctree`. rows: (K, 3) uint32, see
    `corner_rows.py`.
    """

    halves: np.ndarray
    nodes: CodedNodes
    rows: np.ndarray

    @classmethod
    def of(cls, coded: CodedOctree) -> CornerCodes:
        """Codes of an octree."""
        return cls(coded.codes.view(np.int16).ravel(), coded.nodes, coded.corner_rows)


class PixelRays(NamedTuple):
    """Rays of pixels, inputs of the network; see `Hits`."""

    node: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray

    @classmethod
    def of(cls, hits: Hits) -> PixelRays:
        """Rays of all pixels of a view, for kernels."""
        floats = (hits.entry_voxel, hits.direction, hits.up, hits.ratio)
        return cls(
            np.ascontiguousarray(hits.node, np.int64), *(np.ascontiguousarray(array, np.float32) for array in floats)
        )

    def part(self, pixels: np.ndarray) -> PixelRays:
        """Rays of some of the pixels."""
        return PixelRays(*(array[pixels] for array in self))


@device
def gather_look_ahead(nodes, corner_codes, pixel, end, pixels, rows, look_ahead):  # type: ignore[no-untyped-def]
    """Gather pixels from `pixel` on whose nodes have codes, as many as fit a tile, and their rows.

    pixels, rows: (TILE,) int64, written. look_ahead: (P,) bool, set for them. Returns their number, and the next pixel.
    """
    coded = corner_codes.nodes
    count = 0
    while pixel < end and count < TILE:
        row = coded_row(coded, nodes[pixel])
        if row >= 0:
            look_ahead[pixel] = True
            pixels[count], rows[count] = pixel, row
            count += 1
        pixel += 1
    return count, pixel


@device
def write_mean_code(halves, table, row, point, mean):  # type: ignore[no-untyped-def]
    """Write the trilinear mean of a node's eight codes at a point in it, three numbers in [0, 1], into `mean` (16,).

    The code's first eight numbers come first, its last eight follow.
    """
    one = np.float32(1)
    x, y, z = point
    total = splat(np.float32(0))
    for line in range(4):
        share = y if line & 1 else one - y
        share *= z if line & 2 else one - z
        first = corner_row(table, row, 2 * line) * CODE_SIZE
        left, right = splat(share * (one - x) * _SCALE), splat(share * x * _SCALE)
        total = add_product(total, load_halves(halves, first, first + CODE_SIZE - 8), left)
        first += CODE_SIZE  # the corner at x + 1 has the next row
        total = add_product(total, load_halves(halves, first, first + CODE_SIZE - 8), right)
    store(mean, 0, total)


@device
def fill_codes(corner_codes, rows, entry, pixels, inputs):  # type: ignore[no-untyped-def]
    """Write the codes of pixels, interpolated at their entry points, into a tile; rows: of the hit nodes."""
    halves, table = corner_codes.halves, corner_codes.rows
    mean = np.empty(MEAN_SIZE, np.float32)
    for place in range(len(rows)):
        pixel = pixels[place]
        point = entry[pixel, 0], entry[pixel, 1], entry[pixel, 2]
        write_mean_code(halves, table, rows[place], point, mean)
        for k in range(CODE_SIZE):
            inputs[k * TILE + place] = mean[k if k < 8 else k + MEAN_SIZE - CODE_SIZE]


@device
def fill_rays(rays, pixels, inputs):  # type: ignore[no-untyped-def]
    """Write the network's ray inputs of pixels into a tile."""
    direction, up, ratio = rays.direction, rays.up, rays.ratio
    for place in range(len(pixels)):
        pixel = pixels[place]
        for axis in range(3):
            inputs[(DIRECTION + axis) * TILE + place] = direction[pixel, axis]
            inputs[(UP + axis) * TILE + place] = up[pixel, axis]
        inputs[RATIO * TILE + place] = ratio[pixel]
