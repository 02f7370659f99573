# SPDX-License-Identifier: GPL-3.0-or-later
"""Precompute the codes of an octree: all corners of all voxels with look-ahead, on all levels (methods 7.10)."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator

import numpy as np

from ..network.compiled_encode import CompiledEncoder
from ..network.encode import Encoder, NumpyEncoder
from ..network.weights import CODE_SIZE, Weights
from ..octree.octree import Octree
from ..runtime.errors import SettingError
from ..runtime.progress import Progress, Steps
from ..runtime.widths import NODE_ADVICE, UINT32_COUNT, check_count
from .brick import check_nodes
from .coded_nodes import coded_nodes
from .coded_octree import CodedOctree
from .corner_rows import COLUMNS
from .corners import corner_ranges, find_corners, write_corner_rows
from .encode_corners import encode_corners
from .patches import corner_neighbours, voxel_blocks

BACKENDS = ("auto", "compiled", "numpy", "torch")
_LABEL = "Encoding corners"
_HALF_MAX = float(np.finfo(np.float16).max)


def encode_octree(
    octree: Octree,
    weights: Weights,
    *,
    backend: str = "auto",
    device: str = "cpu",
    encoder: Encoder | None = None,
) -> Steps[CodedOctree]:
    """Octree with codes, as many levels ahead as the weights look.

    Corners go range by range, so that what is needed beside octree and codes does not grow with them: about 20 MB.
    `backend` "auto" is torch for another `device` than the CPU, else our compiled products; "numpy" has NumPy's. All
    give the same codes to 1e-4. An `encoder` of these weights counts instead of both. Raises SettingError for a backend
    or device that is not there, and for more nodes or corners than 32 bits can name.
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
    done = 0
    for where in ranges:
        corners = find_corners(octree, coded, where)
        for found in _encode(encoder, octree, where.level, corners, weights):
            codes[done : done + len(found)] = np.clip(found, -_HALF_MAX, _HALF_MAX)
            done += len(found)
            yield Progress(done, len(codes), _LABEL)
    return CodedOctree(octree, weights, codes, table, coded)


def make_encoder(weights: Weights, backend: str = "auto", device: str = "cpu") -> Encoder:
    """Encoder that `encode_octree` uses for these settings."""
    if backend not in BACKENDS:
        raise SettingError(f"Backend '{backend}' is unknown: choose one of {', '.join(BACKENDS)}")
    if backend == "auto":
        backend = "compiled" if device == "cpu" else "torch"
    if backend != "torch":
        if device != "cpu":
            raise SettingError(f"Backend '{backend}' runs on the CPU, not on '{device}': choose backend 'torch'")
        return CompiledEncoder(weights) if backend == "compiled" else NumpyEncoder(weights)
    if importlib.util.find_spec("torch") is None:
        raise SettingError("Backend 'torch' needs PyTorch, which this Python does not have: choose backend 'compiled'")
    from ..network.torch_encode import TorchEncoder

    try:
        return TorchEncoder(weights, device)
    except (RuntimeError, AssertionError) as cause:
        raise SettingError(f"Device '{device}' cannot be used by PyTorch here: choose device 'cpu'") from cause


def _levels(octree: Octree, weights: Weights) -> range:
    """Levels that may have look-ahead."""
    return range(max(octree.depth - weights.lookahead + 1, 0))


def _encode(
    encoder: Encoder, octree: Octree, level: int, corners: np.ndarray, weights: Weights
) -> Iterator[np.ndarray]:
    """Codes (c, 10) float32 of corners (C, 3) of a level, part by part."""
    if isinstance(encoder, CompiledEncoder):
        yield encode_corners(octree, level, corners, encoder.layers, weights.lookahead, encoder.chunk)
        return
    for start in range(0, len(corners), encoder.chunk):
        yield encode_chunk(encoder, octree, level, corners[start : start + encoder.chunk], weights.lookahead)


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
