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
    rows = np.where(hits.node >= 0, coded.coded_index[hits.node], -1)
    pixels = np.flatnonzero(rows >= 0)
    views = hits.entry_voxel[pixels], hits.direction[pixels], hits.up[pixels], hits.ratio[pixels]
    coverage = np.ones(len(rows), np.float32)
    luminance = hits.luminance.astype(np.float32)
    if (device := found_device(device)) != CPU:
        coverage[pixels], luminance[pixels] = decode_on(device, coded, rows[pixels], views)
        return Prediction(coverage, luminance, rows >= 0)
    codes = interpolate_codes(coded, rows[pixels], views[0])
    coverage[pixels], luminance[pixels] = decode(coded.weights, codes, *views[1:])
    return Prediction(coverage, luminance, rows >= 0)


def decode_on(
    device: str, coded: CodedOctree, rows: np.ndarray, views: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (M,) and luminance (M,) of coded nodes by torch, all codes copied to `device` before.

    rows: (M,) of `node_corners`. views: entry in the voxel, direction, up (M, 3) and ratio (M,), see `Hits`.
    """
    from ..network.torch_decode import TorchDecoder

    with enough_memory("decoding"):
        return TorchDecoder(coded.weights, coded.codes, device)(corners_of(coded, rows), *views)


def corners_of(coded: CodedOctree, rows: np.ndarray) -> np.ndarray:
    """Rows (M, 8) in `codes` of the corners of coded nodes, x fastest, for rows (M,) of `node_corners`."""
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
