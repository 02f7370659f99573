# SPDX-License-Identifier: GPL-3.0-or-later
"""Precompute the codes of an octree: all corners of all voxels with look-ahead, on all levels (methods 7.10).

Each core takes chunks of corners from nodes to codes. Most cells of a block are empty, and ReLU zeroes most values of a
layer. So blocks and layers become lists of their non-zero values, each of which adds its row of a matrix to sums in
registers. The corners of a chunk pass one panel of columns together, which then stays in the nearest caches.

A sum takes its terms in the order of columns, those of each octant apart. So codes have the same bits in every chunk
and with any number of threads; only processors without fused multiply-add have others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..cells.leaf_box_kernels import filled_share
from ..cells.scales import LUMINANCE_SCALE, NORMAL_SCALE
from ..network.devices import CPU, enough_memory, found_device
from ..network.encoders import CHANNELS, LUMINANCE, NORMAL, OCCUPANCY, Encoder, octant_matrices
from ..network.kinds import CODE_SIZE, CORNERS
from ..network.weights import Weights
from ..octree.octree import Nodes, Octree
from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.kernels import array_device, device, kernel
from ..runtime.progress import Progress, Steps
from ..runtime.threads import run_parts
from ..runtime.vectors import LANES, add_product, load, spread, store
from .brick import check_nodes, corner_neighbours, covering_node, fill_block, voxel_blocks
from .coded_octree import CodedOctree
from .corner_cells import corner_cells
from .corner_rows import COLUMNS, coded_nodes
from .corners import corner_ranges, places_of

_LABEL = "Encoding corners"
_HALF_MAX = float(np.finfo(np.float16).max)
_CHUNK = 128  # corners: their lists and sums fit a core's second cache
_PANEL = 4 * LANES  # columns: AVX2 has registers for no more; every width is a multiple


class PackedLayers(NamedTuple):
    """Layers of an encoder of width W for the kernel, float32, in panels of 64 columns.

    octants: (8, P, B, 64) of the first layer, by octant. others: (3, P, W, 64) of further layers, the last one padded
    with zeros. bias: (4, W). sees_luminance: whether luminance has nonzero weights; a luminance mixture encodes shape
    only.
    """

    octants: np.ndarray
    others: np.ndarray
    bias: np.ndarray
    sees_luminance: bool

    @classmethod
    def pack(cls, weights: Weights) -> PackedLayers:
        """Layers of these weights for `encode_corners`."""
        matrix = octant_matrices(weights.encoder[0][0])
        width = len(weights.encoder[0][1])
        octants = matrix.reshape(len(matrix), CORNERS, -1, _PANEL).transpose(1, 2, 0, 3)
        others = np.stack([np.pad(matrix, ((0, width - len(matrix)), (0, 0))) for matrix, _ in weights.encoder[1:]])
        return cls(
            np.ascontiguousarray(octants),
            np.ascontiguousarray(others.reshape(len(others), -1, _PANEL, width).swapaxes(2, 3)),
            np.stack([np.pad(bias, (0, width - len(bias))) for _, bias in weights.encoder]),
            bool(matrix[LUMINANCE::CHANNELS].any()),
        )


class _Cells(NamedTuple):
    """Cells of an octree: its nodes, their luminances (n,) uint16 and normals (n, 3) int8."""

    nodes: Nodes
    luminance: np.ndarray
    normal: np.ndarray


class _Lists(NamedTuple):
    """Lists of values and their columns, one after the other; list k is from starts[k] to starts[k + 1]."""

    columns: np.ndarray
    values: np.ndarray
    starts: np.ndarray


def encode_corners(octree: Octree, level: int, corners: np.ndarray, layers: PackedLayers, lookahead: int) -> np.ndarray:
    """Codes (C, 10) float32 of corners (C, 3) int32 of a level."""
    codes = np.empty((len(corners), CODE_SIZE), np.float32)
    cells = _Cells(octree.nodes, octree.luminance, octree.normal)
    run_parts(_encode_chunks, -(-len(corners) // _CHUNK), cells, (level, lookahead), corners, layers, codes)
    return codes


@kernel
def _encode_chunks(
    first: int, last: int, cells: _Cells, levels: tuple[int, int], corners: np.ndarray, layers: PackedLayers,
    codes: np.ndarray,
) -> None:  # fmt: skip
    """Encode chunks of corners. levels: of the corners; look-ahead."""
    size, width = layers.octants.shape[2], layers.bias.shape[1]
    most = _CHUNK * max(CORNERS * size, width)
    lists = _Lists(np.empty(most, np.uint16), np.empty(most, np.float32), np.zeros(CORNERS * _CHUNK + 1, np.int64))
    numbers, own = np.empty((CORNERS, _CHUNK), np.int64), np.arange(_CHUNK)
    sums, zeros = np.empty((_CHUNK, width), np.float32), np.zeros(width, np.float32)
    for start in range(first * _CHUNK, min(last * _CHUNK, len(corners)), _CHUNK):
        count = min(_CHUNK, len(corners) - start)
        _list_blocks(cells, levels, corners[start : start + count], layers.sees_luminance, lists, numbers)
        for corner in range(count):
            for column in range(width):  # by hand: assigning rows takes two seconds more to compile
                sums[corner, column] = layers.bias[0, column]
        for octant in range(CORNERS):
            _add_products(lists, numbers[octant, :count], layers.octants[octant], zeros, sums)
        for layer in range(len(layers.others)):
            place = 0
            for corner in range(count):
                place = _take_positive(lists, place, sums[corner])
                lists.starts[corner + 1] = place
            _add_products(lists, own[:count], layers.others[layer], layers.bias[layer + 1], sums)
        for corner in range(count):
            for column in range(CODE_SIZE):
                codes[start + corner, column] = sums[corner, column]


@array_device
def _list_blocks(cells, levels, corners, with_luminance, lists, numbers):
    """List the blocks around corners, and write the number of each one's list into `numbers` (8, C), by octant."""
    level, lookahead = levels
    nodes = np.empty(1 << 3 * lookahead, np.int32)
    count = place = 0
    for corner in range(len(corners)):
        x, y, z = np.int64(corners[corner, 0]), np.int64(corners[corner, 1]), np.int64(corners[corner, 2])
        follows = corner > 0 and corners[corner - 1, 0] + 1 == x
        follows = follows and corners[corner - 1, 1] == y and corners[corner - 1, 2] == z
        for octant in range(CORNERS):
            if follows and octant & 1 == 0:  # the right voxels of the previous corner are the left ones of this
                numbers[octant, corner] = numbers[octant + 1, corner - 1]
                continue
            column, line, plane = octant & 1, octant >> 1 & 1, octant >> 2
            node = covering_node(cells.nodes, 0, level, x - 1 + column, y - 1 + line, z - 1 + plane)
            if node >= 0:
                fill_block(cells.nodes, node, lookahead, nodes)
                place = _list_block(cells, nodes, with_luminance, lists, place)
            numbers[octant, corner] = count
            count += 1
            lists.starts[count] = place


@device
def _list_block(cells, nodes, with_luminance, lists, place):
    """List the non-zero values of a block's nodes from a place on; returns the next place.

    Luminance without effect is left out, so that it takes no products.
    """
    tree, luminance, normal = cells
    luminance_scale, normal_scale = np.float32(LUMINANCE_SCALE), np.float32(NORMAL_SCALE)
    for cell in range(len(nodes)):
        node, column = np.int64(nodes[cell]), CHANNELS * cell
        if node < 0:
            continue
        boxed = node >= tree.first_boxed
        share = filled_share(tree.boxes, node - tree.first_boxed) if boxed else np.float32(1)
        place = _append(lists, place, column + OCCUPANCY, share)
        if with_luminance:
            place = _append(lists, place, column + LUMINANCE, np.float32(luminance[node]) / luminance_scale)
        for axis in range(3):
            place = _append(lists, place, column + NORMAL + axis, np.float32(normal[node, axis]) / normal_scale)
    return place


@device
def _append(lists, place, column, value):
    """Write a value, and return the next place; that of a zero is used again, since a branch would be slower."""
    lists.columns[place], lists.values[place] = column, value
    return place + (1 if value != 0 else 0)


@device
def _take_positive(lists, place, sums):
    """List the positive ones of sums (W,) from a place on, which is ReLU, and zero all; returns the next place."""
    for column in range(len(sums)):
        lists.columns[place], lists.values[place] = column, sums[column]
        place += 1 if sums[column] > 0 else 0
        sums[column] = np.float32(0)
    return place


@device
def _add_products(lists, numbers, panels, bias, sums):
    """Add to sums (C, W) a bias (W,) and the products of lists with a matrix in panels (P, B, 64); numbers: (C,)."""
    depth, width = panels.shape[1], sums.shape[1]
    for panel in range(len(panels)):
        first = panel * _PANEL
        for corner in range(len(numbers)):
            start, end = lists.starts[numbers[corner]], lists.starts[numbers[corner] + 1]
            columns, values = lists.columns[start:end], lists.values[start:end]
            a, b = load(bias, first), load(bias, first + LANES)
            c, d = load(bias, first + 2 * LANES), load(bias, first + 3 * LANES)
            for index in range(len(columns)):
                row, value = (panel * depth + np.int64(columns[index])) * _PANEL, spread(values, index)
                a = add_product(a, value, load(panels, row))
                b = add_product(b, value, load(panels, row + LANES))
                c = add_product(c, value, load(panels, row + 2 * LANES))
                d = add_product(d, value, load(panels, row + 3 * LANES))
            at = corner * width + first
            store(sums, at, load(sums, at) + a)
            store(sums, at + LANES, load(sums, at + LANES) + b)
            store(sums, at + 2 * LANES, load(sums, at + 2 * LANES) + c)
            store(sums, at + 3 * LANES, load(sums, at + 3 * LANES) + d)


def encode_octree(
    octree: Octree, weights: Weights, *, device: str = CPU, encoder: PackedLayers | Encoder | None = None
) -> Steps[CodedOctree]:
    """Octree with codes for the look-ahead of the weights.

    Beside octree and codes it takes 8 bytes a corner, and at the start about 60 for each voxel of the finest level with
    look-ahead. `device`: cpu for the compiled kernels, else torch's cuda, cuda:N, or auto (`network/devices.py`); all
    give the same codes to 1e-4 and 1e-5 of the largest. An `encoder` of these weights overrides it. Raises SettingError
    for a device that is missing or has too little memory, and for more nodes or corners than 32 bits can index.
    """
    if encoder is None:
        encoder = make_encoder(weights, device)
    yield Progress(0, 1, "Finding corners")
    check_nodes(octree.node_count)
    nodes, count = coded_nodes(octree, weights.lookahead)
    table = np.zeros((count, COLUMNS), np.uint32)
    coded, total = np.flatnonzero(np.unpackbits(nodes.bits.view(np.uint8), bitorder="little")), 0
    ranges, levels = [], max(octree.depth - weights.lookahead + 1, 0)
    for level in range(levels):
        for corners in corner_ranges(octree, coded, level, total, table):
            ranges.append((level, corners))
            total += len(corners)
            yield Progress(level, levels, "Finding corners")
    check_count(total, UINT32_COUNT, "corners of voxels", NODE_ADVICE)
    codes = np.empty((total, CODE_SIZE), np.float16)
    around = np.empty((len(codes), CORNERS), np.uint32) if weights.kind.mixes else None
    with enough_memory("the octree"):
        encode = _corner_encoder(encoder, octree, weights.lookahead)
    done = 0
    for level, numbers in ranges:
        corners = places_of(numbers, level)
        together = max(len(corners), 1) if isinstance(encoder, PackedLayers) else encoder.chunk
        for start in range(0, len(corners), together):
            part = corners[start : start + together]
            with enough_memory("encoding"):
                found = encode(level, part)
            codes[done : done + len(found)] = np.clip(found, -_HALF_MAX, _HALF_MAX)
            if around is not None:
                around[done : done + len(found)] = corner_cells(octree, level, part)
            done += len(found)
            yield Progress(done, len(codes), _LABEL)
    return CodedOctree(octree, weights, codes, table, nodes, around)


def make_encoder(weights: Weights, device: str = CPU) -> PackedLayers | Encoder:
    """Encoder of `encode_octree` on a device; raises SettingError if the device is missing."""
    device = found_device(device)
    if device == CPU:
        return PackedLayers.pack(weights)
    from ..network.torch_encode import TorchEncoder

    with enough_memory("encoding"):
        return TorchEncoder(weights, device)


def _corner_encoder(
    encoder: PackedLayers | Encoder, octree: Octree, lookahead: int
) -> Callable[[int, np.ndarray], np.ndarray]:
    """Function that encodes corners (C, 3) of a level to codes (C, 10) float32.

    On a GPU it gathers the corners' blocks there.
    """
    if isinstance(encoder, PackedLayers):
        return lambda level, corners: encode_corners(octree, level, corners, encoder, lookahead)
    device = getattr(encoder, "device", None)  # only torch encoders have one
    if device is not None and device.type != CPU:
        from .torch_tree import TorchCorners

        return TorchCorners(encoder, octree, lookahead)  # type: ignore[arg-type]
    return lambda level, corners: encoder(*chunk_blocks(octree, level, corners, lookahead))


def chunk_blocks(octree: Octree, level: int, corners: np.ndarray, lookahead: int) -> tuple[np.ndarray, np.ndarray]:
    """Blocks (U, B) of the voxels around corners (C, 3) of a level, and rows (C, 8) in them, as `Encoder` requires."""
    neighbours = corner_neighbours(octree, level, corners)
    nodes, rows = np.unique(np.append(neighbours.reshape(-1), -1), return_inverse=True)  # node -1 comes first
    blocks = voxel_blocks(octree, nodes, lookahead).reshape(len(nodes), -1)
    return blocks, rows.reshape(-1)[:-1].reshape(-1, 8)
