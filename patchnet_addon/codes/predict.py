# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict coverage and luminance behind each pixel's first hit with the network (methods 7.11 to 7.15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import prange

from ..network.decode import decode
from ..network.devices import CPU, enough_memory, found_device
from ..runtime.kernels import kernel
from .coded_octree import CodedOctree
from .patches import OCTANTS

if TYPE_CHECKING:
    from ..tracing.render import Hits

# Compiled CPU code knows no half floats: it looks all 65536 of them up.
_HALF_FLOATS = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction for each of P pixels.

    coverage: (P,) float32, sigma, share of the pixel that the patch covers; 1 where nothing is known.
    luminance: (P,) float32, L_N, mean luminance of that share; that of the preview where nothing is known.
    look_ahead: (P,) bool, the hit voxel has descendants as deep as the patch looks (methods 4.1b); false for misses.
    """

    coverage: np.ndarray
    luminance: np.ndarray
    look_ahead: np.ndarray


def predict(coded: CodedOctree, hits: Hits, device: str = CPU) -> Prediction:
    """Decode coverage and luminance of all pixels.

    Those without look-ahead keep what they show, so that their priority is 0 (methods 4.1b). `device`: cpu, cuda,
    cuda:N, or auto (`network/devices.py`); all give the same to 1e-3. Raises SettingError for one that is not there, or
    has too little memory.
    """
    if (device := found_device(device)) != CPU:
        return predict_on(device, coded, hits)
    rows = rows_of(coded, hits.node)
    pixels = np.flatnonzero(rows >= 0)
    codes = interpolate_codes(coded, rows[pixels], hits.entry_voxel[pixels])
    coverage = np.ones(len(rows), np.float32)
    luminance = hits.luminance.astype(np.float32)
    coverage[pixels], luminance[pixels] = decode(
        coded.weights, codes, hits.direction[pixels], hits.up[pixels], hits.ratio[pixels]
    )
    return Prediction(coverage, luminance, rows >= 0)


def predict_on(device: str, coded: CodedOctree, hits: Hits) -> Prediction:
    """Prediction as `predict` makes it, by torch; all codes are copied to `device`, as torch names it, for this call.

    Raises SettingError where they do not fit.
    """
    from ..network.torch_decode import TorchDecoder

    rows = rows_of(coded, hits.node)
    pixels = np.flatnonzero(rows >= 0)
    coverage = np.ones(len(rows), np.float32)
    luminance = hits.luminance.astype(np.float32)
    with enough_memory("decoding"):
        decode_there = TorchDecoder(coded.weights, coded.codes, device)
        coverage[pixels], luminance[pixels] = decode_there(
            corners_of(coded, rows[pixels]),
            *(part[pixels] for part in (hits.entry_voxel, hits.direction, hits.up, hits.ratio)),
        )
    return Prediction(coverage, luminance, rows >= 0)


def rows_of(coded: CodedOctree, nodes: np.ndarray) -> np.ndarray:
    """Rows (P,) of nodes (P,) among the coded ones, -1 for those without look-ahead and for node -1."""
    rows: np.ndarray = np.where(nodes >= 0, coded.coded_index[nodes], -1)
    return rows


def corners_of(coded: CodedOctree, rows: np.ndarray) -> np.ndarray:
    """Rows (M, 8) in the codes of the corners of coded nodes, x fastest, by the nodes' rows (M,)."""
    corners: np.ndarray = coded.node_corners[rows]
    return corners


def interpolate_codes(coded: CodedOctree, rows: np.ndarray, entry_voxel: np.ndarray) -> np.ndarray:
    """Trilinear means (M, 10) float32 of the codes of coded nodes at points (M, 3) in the voxels, [0, 1]^3.

    The nodes are given as rows (M,) of `node_corners`.
    """
    result = np.empty((len(rows), coded.codes.shape[1]), np.float32)
    halves = coded.codes.view(np.uint16)
    entry = np.ascontiguousarray(entry_voxel, np.float32)
    _interpolate(halves, _HALF_FLOATS, coded.node_corners, np.asarray(rows, np.int64), entry, result)
    return result


def interpolate_codes_reference(coded: CodedOctree, rows: np.ndarray, entry_voxel: np.ndarray) -> np.ndarray:
    """Reference of `interpolate_codes` in NumPy, float64."""
    entry = np.asarray(entry_voxel, np.float64)[:, None, :]
    shares = np.where(OCTANTS == 1, entry, 1 - entry).prod(axis=-1)  # (M, 8)
    codes = coded.codes[coded.node_corners[rows]].astype(np.float64)  # (M, 8, 10)
    return np.einsum("mo,moc->mc", shares, codes)


@kernel
def _interpolate(halves, half_floats, node_corners, rows, entry, result):
    one = np.float32(1)
    for pixel in prange(len(rows)):
        x, y, z = entry[pixel]
        result[pixel] = np.float32(0)
        for octant in range(8):
            share = x if octant & 1 else one - x
            share *= y if octant & 2 else one - y
            share *= z if octant & 4 else one - z
            corner = node_corners[rows[pixel], octant]
            for k in range(result.shape[1]):
                result[pixel, k] += share * half_floats[halves[corner, k]]
