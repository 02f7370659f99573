# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict coverage and luminance behind each pixel's first hit with the network (methods 7.11 to 7.15)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..cells.scales import LUMINANCE_SCALE
from ..directional.node_kernels import luminance_along, row_of
from ..network.compiled_layers import (
    DIRECTION,
    RATIO,
    TILE,
    UP,
    DecoderLayers,
    decode_mixture_tile,
    decode_tile,
    empty_tile,
)
from ..network.kinds import CODE_SIZE, CORNERS, COVERED, COVERING, RAY_INPUTS, SIDE_BY_SIDE, VIEWS
from ..runtime.kernels import array_device, device, kernel
from ..runtime.threads import run_parts
from ..runtime.vectors import HALF_SCALE, add_product, load_halves, splat, store
from .coded_octree import CodedOctree
from .corner_row_kernels import corner_row
from .corner_rows import CodedNodes
from .footprint import PixelRay, clear_tile, measure_tile
from .mixture_inputs import NearbyCells, empty_cell_work, place_pixel
from .prediction import Prediction

if TYPE_CHECKING:
    from ..tracing.hits import Hits

_SCALE = np.float32(HALF_SCALE)
MEAN_SIZE = 16  # of a mean written by `write_mean_code`: two vectors of eight numbers, which overlap in the code
assert 8 <= CODE_SIZE <= 16


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


@device
def gather_look_ahead(nodes, corner_codes, pixel, end, pixels, rows, look_ahead):
    """Gather pixels from `pixel` on whose nodes have codes, as many as fit a tile, and their rows.

    pixels, rows: (TILE,) int64, written. look_ahead: (P,) bool, set for them. Returns their number, and the next pixel.
    """
    coded = corner_codes.nodes
    count = 0
    while pixel < end and count < TILE:
        row = row_of(coded, nodes[pixel])
        if row >= 0:
            look_ahead[pixel] = True
            pixels[count], rows[count] = pixel, row
            count += 1
        pixel += 1
    return count, pixel


@device
def write_mean_code(halves, table, row, point, mean):
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


@array_device
def fill_codes(corner_codes, rows, entry, pixels, inputs):
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
def fill_rays(rays, pixels, inputs):
    """Write the network's ray inputs of pixels into a tile."""
    direction, up, ratio = rays.direction, rays.up, rays.ratio
    for place in range(len(pixels)):
        pixel = pixels[place]
        for axis in range(3):
            inputs[(DIRECTION + axis) * TILE + place] = direction[pixel, axis]
            inputs[(UP + axis) * TILE + place] = up[pixel, axis]
        inputs[RATIO * TILE + place] = ratio[pixel]


def predict(coded: CodedOctree, hits: Hits) -> Prediction:
    """Decode coverage and luminance of all pixels, on all cores of the CPU.

    Pixels without look-ahead keep their preview, so that their priority is 0 (methods 4.1b). A GPU is no faster: the
    cells around each pixel's voxel are found on the CPU and would have to be copied (docs/gpu.md).
    """
    rays = PixelRays.of(hits)
    pixels = len(rays.node)
    prediction = Prediction(
        np.ones(pixels, np.float32), np.array(hits.luminance, np.float32), np.zeros(pixels, np.bool_)
    )
    results = prediction.coverage, prediction.luminance, prediction.look_ahead
    nearby = NearbyCells.of(coded) if coded.weights.kind.mixes else None
    layers = DecoderLayers.pack(coded.weights)
    run_parts(_predict, -(-pixels // TILE), rays, CornerCodes.of(coded), nearby, layers, results)
    return prediction


@kernel
def _predict(
    first: int, last: int, rays: PixelRays, corner_codes: CornerCodes, nearby: NearbyCells | None,
    layers: DecoderLayers, results: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:  # fmt: skip
    """Write coverage and luminance of the pixels with look-ahead in runs of TILE pixels, and the mask of these pixels.

    They are gathered, and decoded when a tile is full. nearby: None for the paper's network; each case is compiled.
    results: coverage, luminance, and the mask of look-ahead.
    """
    coverage, luminance, look_ahead = results
    tile = empty_tile()
    inputs, _, luminances = tile
    work = empty_cell_work()
    pixels, rows = np.empty(TILE, np.int64), np.empty(TILE, np.int64)
    pixel, end = first * TILE, min(last * TILE, len(coverage))
    while pixel < end:
        count, pixel = gather_look_ahead(rays.node, corner_codes, pixel, end, pixels, rows, look_ahead)
        if count == 0:
            break
        fill_codes(corner_codes, rows[:count], rays.entry, pixels, inputs)
        fill_rays(rays, pixels[:count], inputs)
        if nearby is None:
            decode_tile(tile, layers)
        else:
            _fill_corners(corner_codes, rows[:count], inputs)
            _fill_place(rays, nearby, pixels, rows[:count], work, inputs, luminances)
            decode_mixture_tile(tile, layers)
        for place in range(count):
            coverage[pixels[place]] = inputs[place]
            luminance[pixels[place]] = inputs[TILE + place]


@array_device
def _fill_corners(corner_codes, rows, inputs):
    """Write the first numbers of the eight corner codes of pixels side by side; rows: of the hit nodes."""
    halves, table = corner_codes.halves, corner_codes.rows
    code = np.empty(16, np.float32)
    for place in range(len(rows)):
        for corner in range(CORNERS):
            first = corner_row(table, rows[place], corner) * CODE_SIZE
            store(code, 0, load_halves(halves, first, first + CODE_SIZE - 8))
            at = (RAY_INPUTS + SIDE_BY_SIDE * corner) * TILE + place
            for k in range(SIDE_BY_SIDE):
                inputs[at + k * TILE] = code[k] * _SCALE


@device
def _fill_place(rays, nearby, pixels, rows, work, inputs, luminances):
    """Write the viewing rays of pixels, the shares that cells cover, and the luminances to mix."""
    scale = np.float32(1.0 / LUMINANCE_SCALE)
    covered = inputs[COVERED * TILE :]
    clear_tile(work.tile, covered, luminances)
    for place in range(len(rows)):
        pixel = pixels[place]
        node = rays.node[pixel]
        ray = PixelRay(rays.entry[pixel], rays.direction[pixel], rays.up[pixel], rays.ratio[pixel])
        place_pixel(nearby, (node, rows[place]), ray, work, inputs[VIEWS * TILE :], covered, luminances, place)
        x, y, z = ray.direction[0], ray.direction[1], ray.direction[2]
        luminances[COVERING * TILE + place] = luminance_along(nearby.light, node, x, y, z) * scale
    measure_tile(work.tile, covered, luminances)
