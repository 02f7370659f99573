# SPDX-License-Identifier: GPL-3.0-or-later
"""Work of the encoder: how many operations its products need, how many a core can do, and the memory it takes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.network.encode import Encoder
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import drain
from .products import encoder_products

PEAK_SIDE = 2048


def peak_run() -> tuple[str, Callable[[], Any], float]:
    """Large product whose rate is the peak: its library, torch if it is there, else NumPy; a function; operations."""
    random = np.random.default_rng(0)
    left, right = (random.random((PEAK_SIDE, PEAK_SIDE), np.float32) for _ in range(2))
    result = np.empty_like(left)
    operations = 2.0 * PEAK_SIDE**3
    try:
        import torch
    except ImportError:
        return f"NumPy {np.__version__}", lambda: np.matmul(left, right, out=result), operations
    one, other, out = (torch.from_numpy(array) for array in (left, right, result))
    return f"torch {torch.__version__}", lambda: torch.mm(one, other, out=out), operations


def needed_operations(chunk: tuple[np.ndarray, np.ndarray], weights: Weights) -> dict[str, float]:
    """Operations a corner: two for each element of a matrix and of the values that it is multiplied with.

    plain: of whole patches. needed: of the first layer only those of octants that are not empty. not_zero: of these,
    only those with values that are not 0 and that the encoder sees.
    """
    blocks, rows = chunk
    first, *others = encoder_products(chunk, weights)
    corners, columns = len(rows), len(weights.encoder[0][1])
    seen = first.matrix.any(axis=1)
    used = np.count_nonzero(blocks[:, seen], axis=1)[rows].sum()  # block 0 is empty
    rest = 2.0 * sum(product.values.shape[1] * product.matrix.shape[1] for product in others)
    rest_used = 2.0 * sum(np.count_nonzero(product.values) * product.matrix.shape[1] for product in others) / corners
    return {
        "plain": 2.0 * weights.encoder[0][0].size + rest,
        "needed": 2.0 * first.values.shape[1] * columns * np.count_nonzero(rows) / corners + rest,
        "not_zero": 2.0 * columns * float(used) / corners + rest_used,
    }


def measure_memory(octree: Octree, weights: Weights, encoder: Encoder) -> dict[str, Any]:
    """Bytes that encoding takes beside its result at its peak, and bytes that a coded voxel takes beside the codes."""
    tracemalloc.start()
    try:
        coded: CodedOctree = drain(encode_octree(octree, weights, encoder=encoder))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return {
        "scratch_bytes": peak - coded.nbytes,
        "coded_voxels": coded.coded_count,
        "index_bytes_per_voxel": coded.index_nbytes / max(coded.coded_count, 1),
        "all_corners": len(coded.codes),
    }
