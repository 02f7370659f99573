# SPDX-License-Identifier: GPL-3.0-or-later
"""Precompute the codes of an octree: all corners of all voxels with look-ahead, on all levels (methods 7.10)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..network.devices import CPU, enough_memory, found_device
from ..network.encoders import Encoder
from ..network.kinds import CODE_SIZE, CORNERS
from ..network.weights import Weights
from ..octree.octree import Octree
from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.progress import Progress, Steps
from .brick import check_nodes
from .coded_nodes import coded_nodes
from .coded_octree import CodedOctree
from .corner_cells import corner_cells
from .corner_rows import COLUMNS
from .corners import corner_ranges, find_corners, write_corner_rows
from .encode_corners import PackedLayers, encode_corners
from .patches import corner_neighbours, voxel_blocks

if TYPE_CHECKING:
    from .torch_tree import TorchCorners

_LABEL = "Encoding corners"
_HALF_MAX = float(np.finfo(np.float16).max)


def encode_octree(
    octree: Octree, weights: Weights, *, device: str = CPU, encoder: PackedLayers | Encoder | None = None
) -> Steps[CodedOctree]:
    """Octree with codes for the look-ahead of the weights.

    Corners are processed in ranges, so that memory beside octree and codes stays at about 20 MB. `device`: cpu for the
    compiled kernels, else torch's cuda, cuda:N, or auto (`network/devices.py`); all give the same codes to 1e-4 and
    1e-5 of the largest. An `encoder` of these weights overrides it. Raises SettingError for a device that is missing or
    has too little memory, and for more nodes or corners than 32 bits can index.
    """
    if encoder is None:
        encoder = make_encoder(weights, device)
    yield Progress(0, 1, "Finding corners")
    check_nodes(octree.node_count)
    nodes, count = coded_nodes(octree, weights.lookahead)
    table = np.zeros((count, COLUMNS), np.uint32)
    counts: list[int] = []
    levels = range(max(octree.depth - weights.lookahead + 1, 0))
    ranges = [where for level in levels for where in corner_ranges(octree, nodes, level)]
    for where in ranges:
        counts.append(write_corner_rows(octree, nodes, where, sum(counts), table))
        yield Progress(len(counts), len(ranges), "Finding corners")
    check_count(sum(counts), UINT32_COUNT, "corners of voxels", NODE_ADVICE)
    codes = np.empty((sum(counts), CODE_SIZE), np.float16)
    around = np.empty((len(codes), CORNERS), np.uint32) if weights.kind.mixes else None
    with enough_memory("the octree"):
        on_device = _corners_on_device(encoder, octree, weights.lookahead)
    done = 0
    for where in ranges:
        corners = find_corners(octree, nodes, where)
        together = max(len(corners), 1) if isinstance(encoder, PackedLayers) else encoder.chunk
        for start in range(0, len(corners), together):
            part = corners[start : start + together]
            with enough_memory("encoding"):
                if on_device is not None:
                    found = on_device(where.level, part)
                else:
                    found = _encode(encoder, octree, where.level, part, weights.lookahead)
            codes[done : done + len(found)] = np.clip(found, -_HALF_MAX, _HALF_MAX)
            if around is not None:
                around[done : done + len(found)] = corner_cells(octree, where.level, part)
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


def _corners_on_device(encoder: PackedLayers | Encoder, octree: Octree, lookahead: int) -> TorchCorners | None:
    """Encoder that gathers corners' blocks on the encoder's GPU, if there is one with memory for the octree."""
    device = getattr(encoder, "device", None)  # only torch encoders have one
    if device is None or device.type == CPU:
        return None
    from .torch_tree import TorchCorners, tree_fits

    return TorchCorners(encoder, octree, lookahead) if tree_fits(octree, device) else None  # type: ignore[arg-type]


def _encode(
    encoder: PackedLayers | Encoder, octree: Octree, level: int, corners: np.ndarray, lookahead: int
) -> np.ndarray:
    """Codes (C, 10) float32 of corners (C, 3) of a level."""
    if isinstance(encoder, PackedLayers):
        return encode_corners(octree, level, corners, encoder, lookahead)
    return encoder(*chunk_blocks(octree, level, corners, lookahead))


def chunk_blocks(octree: Octree, level: int, corners: np.ndarray, lookahead: int) -> tuple[np.ndarray, np.ndarray]:
    """Blocks (U, B) of the voxels around corners (C, 3) of a level, and rows (C, 8) in them, as `Encoder` requires."""
    neighbours = corner_neighbours(octree, level, corners)
    nodes, rows = np.unique(np.append(neighbours.reshape(-1), -1), return_inverse=True)  # node -1 comes first
    blocks = voxel_blocks(octree, nodes, lookahead).reshape(len(nodes), -1)
    return blocks, rows.reshape(-1)[:-1].reshape(-1, 8)
