# SPDX-License-Identifier: GPL-3.0-or-later
"""Corners per second of the whole encoder: our compiled one and torch's, in turns on the same corners.

Ours goes from the octree's nodes to codes. Torch gets chunks: the blocks of voxels, and which eight each corner has,
made before, outside the time.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from ...patchnet_addon.codes.coded_nodes import coded_nodes
from ...patchnet_addon.codes.corners import corner_ranges, find_corners
from ...patchnet_addon.codes.encode import chunk_blocks, encode_octree
from ...patchnet_addon.codes.encode_corners import encode_corners
from ...patchnet_addon.network.devices import has_torch
from ...patchnet_addon.network.product import PackedLayers
from ...patchnet_addon.network.weights import CHANNELS, Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.threads import limit_threads
from .timing import Comparison, how_measured, take_turns

_CHUNK = 4096
_REST_SECONDS = 0.3


class Chunk(NamedTuple):
    """Corners (C, 3) of a level, and what an `Encoder` takes of them."""

    level: int
    corners: np.ndarray
    blocks: np.ndarray
    rows: np.ndarray


def record_chunks(octree: Octree, weights: Weights, corners: int) -> list[Chunk]:
    """Last chunks of an octree, together up to about `corners`; raises SettingError if there are none."""
    rows, _ = coded_nodes(octree, weights.lookahead)
    found: deque[tuple[int, np.ndarray]] = deque(maxlen=-(-corners // _CHUNK))
    for level in range(max(octree.depth - weights.lookahead + 1, 0)):
        parts = [find_corners(octree, rows, where) for where in corner_ranges(octree, rows, level)]
        every = np.concatenate([np.empty((0, 3), np.int32), *parts])
        found.extend((level, every[start : start + _CHUNK]) for start in range(0, len(every), _CHUNK))
    if not found:
        raise SettingError("This octree has no corners to encode: take one of depth 2 or more")
    return [Chunk(level, part, *chunk_blocks(octree, level, part, weights.lookahead)) for level, part in found]


def benchmark_encoding(octree: Octree, weights: Weights, corners: int, repeats: int, *, threads: int) -> Comparison:
    """Rates of the encoders and of the whole octree; without torch there is no peer.

    One thread is bound to a core and measured in processor seconds, several in wall seconds. Raises SettingError for
    an octree without look-ahead.
    """
    all_cores = threads > 1
    chunks = record_chunks(octree, weights, corners)
    compiled = PackedLayers.pack(weights)
    with limit_threads(threads):
        runs: dict[str, Callable[[], Any]] = {"compiled": lambda: _encode_ours(compiled, octree, weights, chunks)}
        if has_torch():
            runs["torch"] = _torch_run(weights, chunks, threads)
        codes = {name: run() for name, run in runs.items()}  # compiles, too
        coded = drain(encode_octree(octree, weights, encoder=compiled))
        runs["octree"] = lambda: drain(encode_octree(octree, weights, encoder=compiled))
        # Threads of torch spin on after a product, and would take the next one's cores.
        seconds = take_turns(runs, repeats, all_cores=all_cores, prepare=lambda: time.sleep(_REST_SECONDS))
    middle = {name: median(values) for name, values in seconds.items()}
    rates = {name: len(codes["compiled"]) / middle[name] for name in codes}
    details = how_measured(all_cores) | _input_details(chunks) | _code_details(codes)
    details |= {
        "threads": threads,
        "repeats": repeats,
        "corners_per_s": rates,
        "octree_corners_per_s": len(coded.codes) / middle["octree"],
        "all_corners": len(coded.codes),
        "runs": {name: [round(value, 4) for value in values] for name, values in seconds.items()},
        "peer_name": _torch_name() if "torch" in rates else None,
    }
    ours, peer = rates["compiled"], rates.get("torch")
    return Comparison("encode", ours, peer, ours / peer if peer else None, details, unit="corners per second")


def _input_details(chunks: list[Chunk]) -> dict[str, Any]:
    """Count what there is to encode."""
    blocks = [chunk.blocks for chunk in chunks]
    occupied = sum(np.count_nonzero(part[:, ::CHANNELS]) for part in blocks)
    cells = sum(part.size // CHANNELS for part in blocks)
    return {
        "corners": sum(len(chunk.rows) for chunk in chunks),
        "blocks": sum(len(part) for part in blocks),
        "occupied_cells": occupied / cells,
    }


def _code_details(codes: dict[str, np.ndarray]) -> dict[str, Any]:
    """Measure how far the encoders agree."""
    ours = codes["compiled"]
    difference = max(float(np.abs(other - ours).max()) for other in codes.values())
    return {"largest_difference": difference, "largest_code": float(np.abs(ours).max())}


def _encode_ours(layers: PackedLayers, octree: Octree, weights: Weights, chunks: list[Chunk]) -> np.ndarray:
    """Encode level by level, as `encode_octree` does range by range."""
    parts = []
    for level in sorted({chunk.level for chunk in chunks}):
        corners = np.concatenate([chunk.corners for chunk in chunks if chunk.level == level])
        parts.append(encode_corners(octree, level, corners, layers, weights.lookahead))
    return np.concatenate(parts)


def _torch_run(weights: Weights, chunks: list[Chunk], threads: int) -> Callable[[], np.ndarray]:
    import torch

    from ...patchnet_addon.network.torch_encode import TorchEncoder

    torch.set_num_threads(threads)
    encoder = TorchEncoder(weights)
    return lambda: np.concatenate([encoder(chunk.blocks, chunk.rows) for chunk in chunks])


def _torch_name() -> str:
    import torch

    return f"torch {torch.__version__}"
