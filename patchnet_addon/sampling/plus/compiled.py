# SPDX-License-Identifier: GPL-3.0-or-later
"""Error estimator on all cores: runs of pixels of a row pass features and layers within the nearest caches.

A feature of a run is a row of a plane, shifted by its place in the window, so reads are sequential. Runs without an
active pixel are skipped.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from ...network.compiled_layers import OUTPUTS, TILE, apply_layer, empty_values, exponential
from ...runtime.kernels import array_device, device, kernel
from ...runtime.threads import run_parts
from ...runtime.vectors import LANES, add_product, load, spread, store
from .features import HIGHEST, LOWEST
from .forms import CENTRE, FLOOR, Form, Kind, Plane
from .weights import HIDDEN, Estimators

_BAND_ROWS = 256  # whose planes are built at once
_DIFFERENCE, _SLOPE, _ANGLE, _SCALE = (int(kind) for kind in (Kind.DIFFERENCE, Kind.SLOPE, Kind.ANGLE, Kind.SCALE))
_FLOOR, _LOW, _HIGH = np.float32(FLOOR), np.float32(LOWEST), np.float32(HIGHEST)
assert HIDDEN % OUTPUTS == 0


class _Network(NamedTuple):
    """Form and its layers as the kernel reads them.

    kinds, planes, places: (F,) int64 and shares: (F,) float32, of the features, see `Form`. base, depth, per_pixel,
    normal: indices of planes. hidden: weights of both layers with ReLU, in blocks of six outputs, six weights per
    input. last: of the last layer, output by output. skip: of the features in the second output. bias: of all layers.
    floor: (1,) zero, in memory, to be broadcast over a vector. All float32, flat.
    """

    kinds: np.ndarray
    planes: np.ndarray
    places: np.ndarray
    shares: np.ndarray
    base: int
    depth: int
    per_pixel: int
    normal: int
    hidden: np.ndarray
    last: np.ndarray
    skip: np.ndarray
    bias: np.ndarray
    floor: np.ndarray


def estimate(
    planes_of: Callable[[int, int], np.ndarray], active: np.ndarray, estimators: Estimators, form: Form
) -> np.ndarray:
    """Expected error sqrt(E[e^2]), (H, W) float32, of the picture `form.shown` in each active pixel; 0 elsewhere.

    planes_of: the form's planes (C, n + 2, W + 2) float32 of rows first to last - 1, with a border of one pixel.
    active: (H, W) bool.
    """
    network = _packed(estimators, form)
    scores = np.zeros(active.shape, np.float32)
    for first in range(0, len(active), _BAND_ROWS):
        last = min(first + _BAND_ROWS, len(active))
        planes = planes_of(first, last)
        # A run that exceeds its row reads the next row; the last plane is padded for that.
        flat = np.concatenate([planes.ravel(), np.zeros(TILE, np.float32)])
        shape = planes.shape[1], planes.shape[2]
        run_parts(_estimate, last - first, flat, shape, active[first:last], network, scores[first:last])
    return scores


@cache
def _packed(estimators: Estimators, form: Form) -> _Network:
    layers, skip = estimators.networks[form.name]
    hidden = [matrix.reshape(-1, OUTPUTS, matrix.shape[1]).swapaxes(1, 2) for matrix, _ in layers[:-1]]
    kinds, planes, places = form.table
    place = {plane: index for index, plane in enumerate(form.planes)}
    return _Network(
        kinds,
        planes,
        places,
        form.shares,
        place[form.shown],
        place[Plane.DEPTH],
        place[Plane.PER_PIXEL],
        place[Plane.NORMAL_X],
        np.concatenate([blocks.ravel() for blocks in hidden]),
        layers[-1][0].ravel(),
        skip,
        np.concatenate([bias for _, bias in layers]),
        np.zeros(1, np.float32),
    )


@kernel
def _estimate(
    first: int, last: int, planes: np.ndarray, shape: tuple[int, int], active: np.ndarray, network: _Network,
    scores: np.ndarray,
) -> None:  # fmt: skip
    """Write the scores of rows of a band."""
    features, scale = empty_values(len(network.kinds)), np.empty(TILE, np.float32)
    tile, others = empty_values(HIDDEN), empty_values(HIDDEN)
    work = features, scale, tile, others  # features, squared scales, and values between layers of a run
    at = np.empty(9, np.int64)
    width = active.shape[1]
    for row in range(first, last):
        for column in range(0, width, TILE):
            count = min(TILE, width - column)
            if not active[row, column : column + count].any():
                continue
            corner = row * shape[1] + column
            for window in range(len(at)):
                at[window] = corner + window // 3 * shape[1] + window % 3
            _estimate_run(planes, shape[0] * shape[1], at, network, work)
            for place in range(count):
                if active[row, column + place]:
                    scores[row, column + place] = math.sqrt(scale[place] * tile[place])


@array_device
def _estimate_run(planes, size, at, network, work):
    """Estimate a run of pixels: the first row of the third array of `work` gets the squared errors over the squared
    scales.

    size: of a plane. at: (9,) index in a plane of the first pixel's neighbour at each place of the window.
    """
    features, scale, tile, others = work
    depth = len(network.kinds)
    _fill_features(planes, size, at, network, features, scale)
    apply_layer(features, depth, tile, HIDDEN, network.hidden, network.bias, network.floor)
    apply_layer(tile, HIDDEN, others, HIDDEN, network.hidden[depth * HIDDEN :], network.bias[HIDDEN:], network.floor)
    _apply_last(others, features, network, tile)


@array_device
def _fill_features(planes, size, at, network, features, scale):
    """Write the features of a run of pixels and their squared scales; size, at: as in `_estimate_run`."""
    centre = at[CENTRE]
    base, depth = network.base * size + centre, network.depth * size + centre
    per_pixel, normal = network.per_pixel * size + centre, network.normal * size + centre
    for place in range(TILE):
        scale[place] = _FLOOR
    for row in range(len(network.kinds)):
        kind, start = network.kinds[row], network.planes[row] * size + at[network.places[row]]
        to = row * TILE
        if kind == _DIFFERENCE:
            share = network.shares[row]
            for place in range(TILE):
                difference = planes[start + place] - planes[base + place]
                features[to + place] = difference
                scale[place] += share * difference * difference
        elif kind == _SLOPE:
            for place in range(TILE):
                slope = (planes[start + place] - planes[depth + place]) * planes[per_pixel + place]
                features[to + place] = slope / (np.float32(1) + abs(slope))
        elif kind == _ANGLE:
            _fill_angles(planes, start, normal, size, features[to : to + TILE])
        else:
            for place in range(TILE):
                features[to + place] = planes[start + place]
    _divide(network.kinds, features, scale)


@device
def _fill_angles(planes, start, normal, size, cosines):
    """Write the cosines of normals from `start` on with those of the pixels themselves, from `normal` on."""
    for place in range(TILE):
        x = planes[start + place] * planes[normal + place]
        y = planes[start + size + place] * planes[normal + size + place]
        z = planes[start + 2 * size + place] * planes[normal + 2 * size + place]
        cosines[place] = x + y + z


@array_device
def _divide(kinds, features, scale):
    """Divide differences by their pixels' scale, and write its logarithm."""
    inverse = np.empty(TILE, np.float32)
    for place in range(TILE):
        inverse[place] = np.float32(1) / math.sqrt(scale[place])
    for row in range(len(kinds)):
        to = row * TILE
        if kinds[row] == _DIFFERENCE:
            for place in range(TILE):
                features[to + place] *= inverse[place]
        elif kinds[row] == _SCALE:
            for place in range(TILE):
                features[to + place] = math.log(scale[place])


@device
def _apply_last(inputs, features, network, results):
    """Last layer: e^variance + mean^2 in the first row of the results, the mean in the second."""
    last, skip, bias = network.last, network.skip, network.bias
    for pixel in range(0, TILE, LANES):
        variance, mean = spread(bias, 2 * HIDDEN), spread(bias, 2 * HIDDEN + 1)
        for row in range(HIDDEN):
            values = load(inputs, row * TILE + pixel)
            variance = add_product(variance, values, spread(last, row))
            mean = add_product(mean, values, spread(last, HIDDEN + row))
        for row in range(len(skip)):
            mean = add_product(mean, load(features, row * TILE + pixel), spread(skip, row))
        store(results, pixel, variance)
        store(results, TILE + pixel, mean)
    for index in range(TILE):
        mean = results[TILE + index]
        results[index] = exponential(min(max(results[index], _LOW), _HIGH)) + mean * mean
