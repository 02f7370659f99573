# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter over light cells: passes over ever farther neighbours in a surface's plane (methods 7.2h).

Dammertz et al., Edge-Avoiding A-Trous Wavelet Transform for fast Global Illumination Filtering, 2010; guided by noise
as in Schied et al., Spatiotemporal Variance-Guided Filtering, 2017.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..cells.hashing import mixed, row_of_key
from ..cells.morton_kernels import cell_key
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .seen_cells import LEVEL_BITS

STEPS = 1, 2, 4, 8  # distances of averaged cells, pass by pass
_SIGMAS = 3.2  # largest difference of averaged cells, in its standard deviations
_LEAST_NOISE = 0.01  # of the light
_NOTHING = 1e-30
_OWN = np.float32(0.7)  # share of a cell's own noise that counts beside that of those around it
_DISTANCE = 0.25  # decay of weights with the squared distance
_LEAST_WEIGHT = 1e-3  # of a neighbour
NOISE_STEPS = 2  # distances over which noise is averaged
_AROUND = 8  # most neighbours at a distance


class Neighbours(NamedTuple):
    """Neighbours of C cells at one distance: those of cell i are rows[first[i] : first[i + 1]], with weights.

    parts: of a cell's area that an exchange with the neighbour concerns, at most 1. Neighbours are mutual.
    """

    first: np.ndarray
    rows: np.ndarray
    weights: np.ndarray
    parts: np.ndarray


class Places(NamedTuple):
    """Cells of N surfels: `cell` as in `SeenCells`, face, sheet; place in the octree's cube and normal (N, 3); area;
    whether cameras see them, and whether they are filtered.
    """

    cell: np.ndarray
    face: np.ndarray
    sheet: np.ndarray
    unit: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    is_seen: np.ndarray
    is_filtered: np.ndarray


def filtered(
    near_cells: Sequence[Neighbours],
    there: np.ndarray,
    light: np.ndarray,
    half: np.ndarray,
    base: np.ndarray,
    *,
    smooths: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Light (N, C) and its noise (N,) after all passes, one for each distance; without `smooths`, noise alone changes.

    there: (N,) bool, cells with light. half: (N,) float32, see `SurfelSums`. It passes through the same
    filter, so that its mean square over cells around is the variance that is left. base: (N, C) float32, colours that
    light was divided by. Passes average light times base, and base, since a mean of quotients is too large where base
    varies, as between the lines of a texture: a surfel's paths and its base colour see slightly different places.
    """
    noise = _noise(near_cells[:NOISE_STEPS], there, half)
    if not smooths:
        return light, np.sqrt(0.5 * (noise**2 + half**2))
    channels, guide, apart = light.shape[1], np.empty_like(noise), np.empty_like(noise)
    values = np.concatenate([light * base, half[:, None] * base[:, :1], base], axis=1)
    for number, near in enumerate(near_cells):
        if number == 0:  # light and noise of a few paths are too rough to tell which neighbours are alike
            run_parts(_blur, len(noise), near, there, light, noise, guide, apart)
        weights, totals, smooth = np.empty(len(near.rows), np.float32), np.empty_like(noise), np.empty_like(values)
        run_parts(_weigh, len(noise), near, there, guide, apart, weights, totals)
        run_parts(_filter, len(noise), near, weights, totals, values, smooth)
        values = smooth
        light, half = values[:, :channels] / values[:, channels + 1 :], values[:, channels] / values[:, channels + 1]
        noise = _noise(near_cells[number : number + NOISE_STEPS], there, half)
        # A bright cell of a few paths is noisier than those around it.
        guide, apart = np.ascontiguousarray(light[:, 0]), np.maximum(noise, _OWN * np.abs(half))
    return light, noise


def _noise(near_cells: Sequence[Neighbours], there: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Noise (N,) float32 of cells: root of the mean square of `half` over their neighbours, pass by pass."""
    variance = half**2
    for near in near_cells:
        around = np.empty_like(variance)
        run_parts(_spread, len(variance), near, there, variance, around)
        variance = around
    return np.sqrt(variance)


def neighbours(keys: np.ndarray, slots: np.ndarray, places: Places, step: int) -> Neighbours:
    """Neighbours of cells at a distance of `step` cells in their planes, of the same face and sheet.

    They have the same level or, where cameras see no such cell, the next coarser one.
    """
    count = len(keys)
    found, alike = np.full((count, _AROUND), -1, np.int32), np.empty((count, _AROUND), np.float32)
    run_parts(_find_neighbours, count, keys, slots, places, step, found, alike)
    missing = np.zeros((count, _AROUND), np.bool_)
    run_parts(_find_missing, count, found, missing)
    counts = (found >= 0).sum(axis=1) + np.bincount(found[missing], minlength=count)
    first = np.concatenate([[0], np.cumsum(counts)])
    mutual = Neighbours(first, *(np.empty(first[-1], kind) for kind in (np.int32, np.float32, np.float32)))
    _join(found, alike, missing, places.area, first[:-1].copy(), mutual)
    return mutual


@kernel
def _find_neighbours(first, last, keys, slots, places, step, found, alike):
    for i in range(first, last):
        count = 0
        if not places.is_filtered[i]:
            continue
        one, two = _tangents(places.normal[i, 0], places.normal[i, 1], places.normal[i, 2])
        for n in range(9):
            across, up = n % 3 - 1, n // 3 - 1
            if across == 0 and up == 0:  # its place may be in another cell, by rounding
                continue
            away = float(step * across), float(step * up)
            row = _neighbour(keys, slots, places, i, away, one, two, 0)
            if row < 0 and places.is_seen[i]:
                row = _neighbour(keys, slots, places, i, away, one, two, 1)
                if row >= 0 and not places.is_seen[row]:
                    continue
            if row < 0 or row == i:
                continue
            weight = _alike(places, i, row) * math.exp(-_DISTANCE * (across * across + up * up))
            if weight > _LEAST_WEIGHT and not _contains(found[i], row):
                found[i, count], alike[i, count] = row, weight
                count += 1


@kernel
def _find_missing(first, last, found, missing):
    """Mark neighbours that a cell has and that do not have it."""
    for i in range(first, last):
        for n in range(found.shape[1]):
            missing[i, n] = found[i, n] >= 0 and not _contains(found[found[i, n]], i)


@kernel
def _join(found, alike, missing, area, at, mutual):
    """Write the neighbours that cells have, and those that miss them, each from index `at` (C,) on."""
    for i in range(len(found)):
        for n in range(found.shape[1]):
            row = found[i, n]
            if row >= 0:
                _put(mutual, at, i, row, alike[i, n], area)
                if missing[i, n]:
                    _put(mutual, at, row, i, alike[i, n], area)


@device
def _put(mutual, at, i, row, weight, area):
    mutual.rows[at[i]], mutual.weights[at[i]] = row, weight
    mutual.parts[at[i]] = min(area[row] / area[i], 1.0)
    at[i] += 1


@device
def _contains(rows, row):
    found = False
    for other in rows:
        found |= other == row
    return found


@device
def _tangents(x, y, z):
    """Two unit vectors across a unit normal and each other, along the axes of the octree if the normal is."""
    if abs(x) >= abs(y) and abs(x) >= abs(z):
        length = math.sqrt(x * x + y * y)
        one = (-y / length, x / length, 0.0)
    elif abs(y) >= abs(z):
        length = math.sqrt(y * y + z * z)
        one = (0.0, -z / length, y / length)
    else:
        length = math.sqrt(z * z + x * x)
        one = (z / length, 0.0, -x / length)
    return one, (y * one[2] - z * one[1], z * one[0] - x * one[2], x * one[1] - y * one[0])


@device
def _neighbour(keys, slots, places, i, away, one, two, coarser):
    """Row of the cell around a point `away` in the plane of a cell, or next to that one along the face's axis; -1 for
    none. coarser: levels that it is above the cell.
    """
    own = np.int64(places.cell[i] & np.uint64((1 << LEVEL_BITS) - 1))
    if own < coarser:
        return np.int64(-1)
    level = own - coarser
    side, scale = np.int64(1) << level, 0.5**coarser
    x = math.floor(places.unit[i, 0] * side + scale * (away[0] * one[0] + away[1] * two[0]))
    y = math.floor(places.unit[i, 1] * side + scale * (away[0] * one[1] + away[1] * two[1]))
    z = math.floor(places.unit[i, 2] * side + scale * (away[0] * one[2] + away[1] * two[2]))
    axis = places.face[i] // 2
    for off in range(3):
        by = (off + 1) % 3 - 1  # 0, 1, -1
        a, b, c = x + by * (axis == 0), y + by * (axis == 1), z + by * (axis == 2)
        if a < 0 or b < 0 or c < 0 or a >= side or b >= side or c >= side:
            continue
        other = (cell_key(a, b, c) << np.uint64(LEVEL_BITS)) | np.uint64(level)
        row = row_of_key(slots, keys, mixed(mixed(other, places.face[i]), places.sheet[i]))
        if row >= 0 and places.is_filtered[row]:
            return row
    return np.int64(-1)


@device
def _alike(places, i, j):
    """Weight of how well two cells' surfaces lie in one plane."""
    cosine = 0.0
    height = 0.0
    length = 0.0
    for axis in range(3):
        cosine += places.normal[i, axis] * places.normal[j, axis]
        apart = places.unit[j, axis] - places.unit[i, axis]
        height += apart * places.normal[i, axis]
        length += apart * apart
    if cosine <= 0.0:
        return 0.0
    return cosine**8 * math.exp(-9.0 * height * height / max(length, 1e-300))


@kernel
def _spread(first, last, near, there, variance, out):
    """Write the mean variance of cells and their neighbours: that of a few paths is rough itself."""
    for i in range(first, last):
        total, count = float(variance[i]), 1
        for n in range(near.first[i], near.first[i + 1]):
            if there[near.rows[n]] and there[i]:
                total += variance[near.rows[n]]
                count += 1
        out[i] = total / count


@kernel
def _blur(first, last, near, there, light, noise, guide, left):
    """Write means of luminance over cells and their neighbours, and the noise of these."""
    for i in range(first, last):
        total, variance, weights = float(light[i, 0]), float(noise[i]) ** 2, 1.0
        for n in range(near.first[i], near.first[i + 1]):
            row, weight = near.rows[n], float(near.weights[n])
            if there[row] and there[i]:
                total += weight * light[row, 0]
                variance += weight * weight * float(noise[row]) ** 2
                weights += weight
        guide[i] = total / weights
        left[i] = math.sqrt(variance) / weights


@kernel
def _weigh(first, last, near, there, guide, apart, weights, totals):
    """Write the weight of each neighbour, by how well the guides (N,) agree within their noise, and each cell's sum."""
    for i in range(first, last):
        total = 1.0
        for n in range(near.first[i], near.first[i + 1]):
            row = near.rows[n]
            weights[n] = 0.0
            if not there[row] or not there[i]:
                continue
            sigma = _SIGMAS * math.sqrt(float(apart[i]) ** 2 + float(apart[row]) ** 2)
            sigma += _LEAST_NOISE * max(abs(float(guide[i])), abs(float(guide[row]))) + _NOTHING
            differs = (float(guide[row]) - float(guide[i])) / sigma
            weights[n] = near.weights[n] * math.exp(-differs * differs)
            total += weights[n] * near.parts[n]
        totals[i] = total


@kernel
def _filter(first, last, near, weights, totals, values, smooth):
    """Write means over neighbours of values (N, C).

    Two cells exchange as much light, so that the sum over all areas stays: else cells that few others agree with, the
    bright ones of a few paths, would count less.
    """
    channels = values.shape[1]
    sums = np.empty(channels)
    for i in range(first, last):
        own = 1.0
        sums[:] = 0.0
        for n in range(near.first[i], near.first[i + 1]):
            row = near.rows[n]
            share = float(weights[n]) * near.parts[n] / max(float(totals[i]), float(totals[row]))
            own -= share
            for c in range(channels):
                sums[c] += share * values[row, c]
        for c in range(channels):
            smooth[i, c] = sums[c] + own * values[i, c]
