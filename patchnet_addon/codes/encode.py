# SPDX-License-Identifier: GPL-3.0-or-later
"""Precompute the codes of an octree: all corners of all voxels with look-ahead, on all levels (methods 7.10)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..network.compiled_encode import CompiledEncoder
from ..network.devices import AUTO, CPU, enough_memory, found_device, has_torch, read_device
from ..network.encode import Encoder, NumpyEncoder
from ..network.kinds import CODE_SIZE, CORNERS
from ..network.weights import Weights
from ..octree.octree import Octree
from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.errors import SettingError
from ..runtime.progress import Progress, Steps
from .brick import check_nodes
from .coded_nodes import coded_nodes
from .coded_octree import CodedOctree
from .corner_cells import corner_cells
from .corner_rows import COLUMNS
from .corners import corner_ranges, find_corners, write_corner_rows
from .encode_corners import encode_corners
from .patches import corner_neighbours, voxel_blocks

if TYPE_CHECKING:
    from .torch_tree import TorchCorners

BACKENDS = ("auto", "compiled", "numpy", "torch")
_LABEL = "Encoding corners"
_HALF_MAX = float(np.finfo(np.float16).max)


def encode_octree(
    octree: Octree,
    weights: Weights,
    *,
    backend: str = "auto",
    device: str = CPU,
    encoder: Encoder | None = None,
) -> Steps[CodedOctree]:
    """Octree with codes, as many levels ahead as the weights look.

    Corners go range by range, so that what is needed beside octree and codes does not grow with them: about 20 MB.
    `backend` "auto" is torch for another `device` than the CPU, else our compiled products; "numpy" has NumPy's. All
    give the same codes to 1e-4 and 1e-5 of the largest. `device`: cpu, cuda, cuda:N, or auto (`network/devices.py`). An
    `encoder` of these weights counts instead of both. Raises SettingError for a backend or device that is not there, or
    has too little memory, and for more nodes or corners than 32 bits can name.
    """
    if encoder is None:
        encoder = make_encoder(weights, backend, device)
    yield Progress(0, 1, "Finding corners")
    check_nodes(octree.node_count)
    coded = coded_nodes(octree, weights.lookahead)
    table = np.zeros((coded.total, COLUMNS), np.uint32)
    counts: list[int] = []
    ranges = [where for level in _levels(octree, weights) for where in corner_ranges(octree, coded, level)]
    for where in ranges:
        counts.append(write_corner_rows(octree, coded, where, sum(counts), table))
        yield Progress(len(counts), len(ranges), "Finding corners")
    check_count(sum(counts), UINT32_COUNT, "corners of voxels", NODE_ADVICE)
    codes = np.empty((sum(counts), CODE_SIZE), np.float16)
    around = np.empty((len(codes), CORNERS), np.uint32) if weights.kind.mixes else None
    with enough_memory("the octree"):
        on_device = _corners_on_device(encoder, octree, weights.lookahead)
    done = 0
    for where in ranges:
        corners = find_corners(octree, coded, where)
        for start in range(0, len(corners), _part(encoder, corners)):
            part = corners[start : start + _part(encoder, corners)]
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
    return CodedOctree(octree, weights, codes, table, coded, around)


def make_encoder(weights: Weights, backend: str = "auto", device: str = CPU) -> Encoder:
    """Encoder that `encode_octree` uses for these settings; raises SettingError for what is not there."""
    if backend not in BACKENDS:
        raise SettingError(f"Backend '{backend}' is unknown: choose one of {', '.join(BACKENDS)}")
    if backend in ("compiled", "numpy"):
        if read_device(device) not in (AUTO, CPU):
            raise SettingError(f"Backend '{backend}' runs on the CPU, not on '{device}': choose backend 'torch'")
        return CompiledEncoder(weights) if backend == "compiled" else NumpyEncoder(weights)
    device = found_device(device)
    if backend == "auto" and device == CPU:
        return CompiledEncoder(weights)
    if not has_torch():
        raise SettingError("Backend 'torch' needs PyTorch, which this Python does not have: choose backend 'compiled'")
    from ..network.torch_encode import TorchEncoder

    with enough_memory("encoding"):
        return TorchEncoder(weights, device)


def _corners_on_device(encoder: Encoder, octree: Octree, lookahead: int) -> TorchCorners | None:
    """Encoder of corners whose blocks the encoder's GPU gathers, if it is one and has room for the octree."""
    device = getattr(encoder, "device", None)  # only torch's has one
    if device is None or device.type == CPU:
        return None
    from .torch_tree import TorchCorners, tree_fits

    return TorchCorners(encoder, octree, lookahead) if tree_fits(octree, device) else None  # type: ignore[arg-type]


def _levels(octree: Octree, weights: Weights) -> range:
    """Levels that may have look-ahead."""
    return range(max(octree.depth - weights.lookahead + 1, 0))


def _part(encoder: Encoder, corners: np.ndarray) -> int:
    """Number of corners that an encoder is given at once; the compiled one makes its own chunks."""
    return max(len(corners), 1) if isinstance(encoder, CompiledEncoder) else encoder.chunk


def _encode(encoder: Encoder, octree: Octree, level: int, corners: np.ndarray, lookahead: int) -> np.ndarray:
    """Codes (C, 10) float32 of corners (C, 3) of a level."""
    if isinstance(encoder, CompiledEncoder):
        return encode_corners(octree, level, corners, encoder.layers, lookahead, encoder.chunk)
    return encode_chunk(encoder, octree, level, corners, lookahead)


def encode_chunk(encoder: Encoder, octree: Octree, level: int, corners: np.ndarray, lookahead: int) -> np.ndarray:
    """Codes (C, 10) float32 of corners (C, 3) of a level; every voxel around them is read once.

    Reference of `encode_corners`, with the same bits if the encoder is `CompiledEncoder`.
    """
    return encoder(*chunk_blocks(octree, level, corners, lookahead))


def chunk_blocks(octree: Octree, level: int, corners: np.ndarray, lookahead: int) -> tuple[np.ndarray, np.ndarray]:
    """Blocks (U, B) of the voxels around corners (C, 3) of a level, and rows (C, 8) in them, as an `Encoder` asks."""
    neighbours = corner_neighbours(octree, level, corners)
    nodes, rows = np.unique(np.append(neighbours.reshape(-1), -1), return_inverse=True)  # node -1 comes first
    blocks = voxel_blocks(octree, nodes, lookahead).reshape(len(nodes), -1)
    return blocks, rows.reshape(-1)[:-1].reshape(-1, 8)
