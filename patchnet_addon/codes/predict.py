# SPDX-License-Identifier: GPL-3.0-or-later
"""Predict coverage and luminance behind each pixel's first hit with the network (methods 7.11 to 7.15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..network.compiled_decode import DIRECTION, RATIO, TILE, UP, DecoderLayers, decode_tile, empty_tile
from ..network.decode import decode
from ..network.devices import CPU, enough_memory, found_device
from ..network.weights import CODE_SIZE
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .coded_nodes import coded_row
from .coded_octree import CodedOctree
from .corner_codes import MEAN_SIZE, CornerCodes, write_mean_code
from .patches import OCTANTS

if TYPE_CHECKING:
    from ..tracing.render import Hits


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


class _Rays(NamedTuple):
    """What the network is given of each pixel's ray; see `Hits`."""

    node: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray


def predict(coded: CodedOctree, hits: Hits, device: str = CPU) -> Prediction:
    """Decode coverage and luminance of all pixels, on all cores of the CPU or on a GPU.

    Those without look-ahead keep what they show, so that their priority is 0 (methods 4.1b). `device`: cpu, cuda,
    cuda:N, or auto (`network/devices.py`); all give the same to 1e-3. Raises SettingError for one that is not there, or
    has too little memory.
    """
    if (device := found_device(device)) != CPU:
        return predict_on(device, coded, hits)
    entry, direction, up, ratio = (
        np.ascontiguousarray(array, np.float32) for array in (hits.entry_voxel, hits.direction, hits.up, hits.ratio)
    )
    rays = _Rays(np.ascontiguousarray(hits.node, np.int64), entry, direction, up, ratio)
    pixels = len(rays.node)
    prediction = Prediction(
        np.ones(pixels, np.float32), np.array(hits.luminance, np.float32), np.zeros(pixels, np.bool_)
    )
    run_parts(
        _predict,
        -(-pixels // TILE),
        rays,
        CornerCodes.of(coded),
        DecoderLayers.pack(coded.weights),
        prediction.coverage,
        prediction.luminance,
        prediction.look_ahead,
    )
    return prediction


def predict_reference(coded: CodedOctree, hits: Hits) -> Prediction:
    """Reference of `predict` in NumPy."""
    rows = coded.rows_of(hits.node)
    pixels = np.flatnonzero(rows >= 0)
    codes = interpolate_codes_reference(coded, rows[pixels], hits.entry_voxel[pixels])
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

    rows = coded.rows_of(hits.node)
    pixels = np.flatnonzero(rows >= 0)
    coverage = np.ones(len(rows), np.float32)
    luminance = hits.luminance.astype(np.float32)
    with enough_memory("decoding"):
        decode_there = TorchDecoder(coded.weights, coded.codes, device)
        coverage[pixels], luminance[pixels] = decode_there(
            coded.corners_of(rows[pixels]),
            *(part[pixels] for part in (hits.entry_voxel, hits.direction, hits.up, hits.ratio)),
        )
    return Prediction(coverage, luminance, rows >= 0)


def interpolate_codes_reference(coded: CodedOctree, rows: np.ndarray, entry_voxel: np.ndarray) -> np.ndarray:
    """Trilinear means (M, 10) float64 of the codes of coded nodes at points (M, 3) in the voxels, [0, 1]^3.

    The nodes are given as rows (M,) of `corner_rows`.
    """
    entry = np.asarray(entry_voxel, np.float64)[:, None, :]
    shares = np.where(OCTANTS == 1, entry, 1 - entry).prod(axis=-1)  # (M, 8)
    codes = coded.codes[coded.corners_of(rows)].astype(np.float64)  # (M, 8, 10)
    return np.einsum("mo,moc->mc", shares, codes)


@kernel
def _predict(first, last, rays, corner_codes, layers, coverage, luminance, look_ahead):  # type: ignore[no-untyped-def]
    """Write coverage and luminance of the pixels with look-ahead in runs of TILE pixels, and which these are.

    They are gathered, and decoded when they fill a tile.
    """
    tile = empty_tile(), empty_tile()
    pixels, rows = np.empty(TILE, np.int64), np.empty(TILE, np.int64)
    nodes, bits, before = rays.node, corner_codes.bits, corner_codes.before
    count = 0
    end = min(last * TILE, len(coverage))
    for pixel in range(first * TILE, end):
        row = coded_row(bits, before, nodes[pixel])
        if row >= 0:
            look_ahead[pixel] = True
            pixels[count], rows[count] = pixel, row
            count += 1
        if count == TILE or (pixel == end - 1 and count > 0):
            _fill_codes(corner_codes, rows[:count], rays.entry, pixels, tile[0])
            _fill_rays(rays.direction, rays.up, rays.ratio, pixels[:count], tile[0])
            outputs = decode_tile(tile[0], tile[1], layers)
            for place in range(count):
                coverage[pixels[place]] = outputs[place]
                luminance[pixels[place]] = outputs[TILE + place]
            count = 0


@device
def _fill_codes(corner_codes, rows, entry, pixels, inputs):  # type: ignore[no-untyped-def]
    """Write the codes of pixels, interpolated at their entry points, into a tile; rows: of the nodes they hit."""
    halves, table = corner_codes.halves, corner_codes.rows
    mean = np.empty(MEAN_SIZE, np.float32)
    for place in range(len(rows)):
        pixel = pixels[place]
        point = entry[pixel, 0], entry[pixel, 1], entry[pixel, 2]
        write_mean_code(halves, table, rows[place], point, mean)
        for k in range(CODE_SIZE):
            inputs[k * TILE + place] = mean[k if k < 8 else k + MEAN_SIZE - CODE_SIZE]


@device
def _fill_rays(direction, up, ratio, pixels, inputs):  # type: ignore[no-untyped-def]
    """Write what the network is given of the rays of pixels into a tile."""
    for place in range(len(pixels)):
        pixel = pixels[place]
        for axis in range(3):
            inputs[(DIRECTION + axis) * TILE + place] = direction[pixel, axis]
            inputs[(UP + axis) * TILE + place] = up[pixel, axis]
        inputs[RATIO * TILE + place] = ratio[pixel]
