# SPDX-License-Identifier: GPL-3.0-or-later
"""Precompute the codes of an octree: all corners of all voxels with look-ahead, on all levels (methods 7.10)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..network.compiled_encode import CompiledEncoder
from ..network.devices import AUTO, CPU, enough_memory, found_device, has_torch, read_device
from ..network.encode import Encoder, NumpyEncoder
from ..network.weights import CODE_SIZE, Weights
from ..octree.octree import Octree
from ..runtime.errors import SettingError
from ..runtime.progress import Progress, Steps
from .coded_octree import CodedOctree
from .patches import corner_neighbours, corner_table, voxel_blocks

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
    """Octree with codes, as many levels ahead as the weights look; corners go chunk by chunk in Morton order, so that
    memory stays bounded.

    `backend` "auto" is torch for another `device` than the CPU, else our compiled products; "numpy" has NumPy's. All
    give the same codes to 1e-4 and 1e-5 of the largest. `device`: cpu, cuda, cuda:N, or auto (`network/devices.py`). An
    `encoder` of these weights counts instead of both. Raises SettingError for a backend or device that is not there, or
    has too little memory.
    """
    if encoder is None:
        encoder = make_encoder(weights, backend, device)
    yield Progress(0, 1, "Finding corners")
    coded = octree.look_ahead(weights.lookahead)
    levels, node_corners, total = [], [], 0
    for level in range(max(octree.depth - weights.lookahead + 1, 0)):
        nodes = np.flatnonzero(coded[octree.level(level)]) + octree.level_start[level]
        corners, rows = corner_table(octree, level, nodes)
        levels.append((level, corners, total))
        node_corners.append(rows + np.uint32(total))
        total += len(corners)
        yield Progress(level + 1, octree.depth, "Finding corners")
    codes = np.zeros((total, CODE_SIZE), np.float16)
    with enough_memory("the octree"):
        on_device = _corners_on_device(encoder, octree, weights.lookahead)
    for level, corners, first in levels:
        for start in range(0, len(corners), encoder.chunk):
            chunk = corners[start : start + encoder.chunk]
            done = first + start + len(chunk)
            with enough_memory("encoding"):
                if on_device is not None:
                    found = on_device(level, chunk)
                else:
                    found = _encode_chunk(encoder, octree, level, chunk, weights.lookahead)
            codes[first + start : done] = np.clip(found, -_HALF_MAX, _HALF_MAX)
            yield Progress(done, total, _LABEL)
    rows = np.concatenate(node_corners) if node_corners else np.zeros((0, 8), np.uint32)
    return CodedOctree(octree, weights, codes, rows)


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


def _encode_chunk(encoder: Encoder, octree: Octree, level: int, corners: np.ndarray, lookahead: int) -> np.ndarray:
    """Codes (C, 10) float32 of corners (C, 3) of a level; every voxel around them is read once."""
    neighbours = corner_neighbours(octree, level, corners)
    nodes, rows = np.unique(np.append(neighbours.reshape(-1), -1), return_inverse=True)  # node -1 comes first
    blocks = voxel_blocks(octree, nodes, lookahead).reshape(len(nodes), -1)
    return encoder(blocks, rows.reshape(-1)[:-1].reshape(-1, 8))
