# SPDX-License-Identifier: GPL-3.0-or-later
"""Corners per second of the whole encoder: our compiled one, NumPy's and torch's, in turns on the same chunks.

A chunk is what `encode_octree` hands an encoder: the blocks of voxels, and which eight each corner has. They are made
before, outside the time.
"""

from __future__ import annotations

import importlib.util
from collections import deque
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.network.compiled_encode import CompiledEncoder
from ...patchnet_addon.network.encode import Encoder, NumpyEncoder
from ...patchnet_addon.network.weights import CHANNELS, CODE_SIZE, Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.octree.voxelize import usable_cores
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import drain
from .products import measure_products
from .timing import Comparison, how_measured, take_turns

Chunk = tuple[np.ndarray, np.ndarray]


class _Recorder:
    """Recorder: an `Encoder` that keeps the last chunks, which are those of the finest level, and encodes nothing."""

    chunk = CompiledEncoder.chunk

    def __init__(self, most: int) -> None:
        self.chunks: deque[Chunk] = deque(maxlen=most)

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        self.chunks.append((blocks, rows))
        return np.zeros((len(rows), CODE_SIZE), np.float32)


def record_chunks(octree: Octree, weights: Weights, corners: int) -> list[Chunk]:
    """Last chunks of an octree, together up to about `corners`; raises SettingError if there are none."""
    recorder = _Recorder(-(-corners // _Recorder.chunk))
    drain(encode_octree(octree, weights, encoder=recorder))
    if not recorder.chunks:
        raise SettingError("This octree has no corners to encode: take one of depth 2 or more")
    return list(recorder.chunks)


def benchmark_encoding(
    octree: Octree, weights: Weights, corners: int = 50_000, repeats: int = 9, *, all_cores: bool = True
) -> Comparison:
    """Rates of the encoders, and of the products that they are made of.

    On one core, in processor seconds, only if all libraries were told to use one thread before they were loaded
    (`threads.py`). Raises SettingError for an octree without look-ahead.
    """
    chunks = record_chunks(octree, weights, corners)
    encoders = _encoders(weights, all_cores)
    codes = {name: _encode(encoder, chunks) for name, encoder in encoders.items()}  # compiles, too
    runs: dict[str, Callable[[], Any]] = {
        name: lambda encoder=encoder: _encode(encoder, chunks)  # type: ignore[misc]
        for name, encoder in encoders.items()
    }
    seconds = take_turns(runs, repeats, all_cores=all_cores)
    count = len(codes["compiled"])
    rates = {name: count / median(values) for name, values in seconds.items()}
    largest = max(chunks, key=lambda chunk: len(chunk[1]))
    details = how_measured(all_cores) | _input_details(chunks) | _code_details(codes)
    details |= {
        "repeats": repeats,
        "corners_per_s": rates,
        "runs": {name: [round(value, 4) for value in values] for name, values in seconds.items()},
        "peer_name": f"NumPy {np.__version__}",
        "torch": _torch_name(),
        "products": measure_products(largest, weights, repeats, all_cores=all_cores),
    }
    ours, peer = rates["compiled"], rates["numpy"]
    return Comparison("encode", ours, peer, ours / peer, details, unit="corners per second")


def _input_details(chunks: list[Chunk]) -> dict[str, Any]:
    """Count what there is to encode."""
    blocks = [blocks for blocks, _ in chunks]
    occupied = sum(np.count_nonzero(part[:, ::CHANNELS]) for part in blocks)
    cells = sum(part.size // CHANNELS for part in blocks)
    return {
        "corners": sum(len(rows) for _, rows in chunks),
        "blocks": sum(len(part) for part in blocks),
        "occupied_cells": occupied / cells,
    }


def _code_details(codes: dict[str, np.ndarray]) -> dict[str, Any]:
    """Measure how far the encoders agree."""
    ours = codes["compiled"]
    difference = max(float(np.abs(other - ours).max()) for other in codes.values())
    return {"largest_difference": difference, "largest_code": float(np.abs(ours).max())}


def _encode(encoder: Encoder, chunks: list[Chunk]) -> np.ndarray:
    return np.concatenate([encoder(*chunk) for chunk in chunks])


def _encoders(weights: Weights, all_cores: bool) -> dict[str, Encoder]:
    encoders: dict[str, Encoder] = {"compiled": CompiledEncoder(weights), "numpy": NumpyEncoder(weights)}
    if has_torch():
        import torch

        from ...patchnet_addon.network.torch_encode import TorchEncoder

        torch.set_num_threads(usable_cores() if all_cores else 1)
        encoders["torch"] = TorchEncoder(weights)
    return encoders


def has_torch() -> bool:
    """Return whether torch can be measured, too."""
    return importlib.util.find_spec("torch") is not None


def _torch_name() -> str | None:
    if not has_torch():
        return None
    import torch

    return f"torch {torch.__version__}"
