# SPDX-License-Identifier: GPL-3.0-or-later
"""Views of training voxels as they are stored, 16 bits a number, read and turned by kernels (methods 7.20)."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.kernels import device
from .samples import COVERAGE_SCALE, SIGNED, UNIT


@device
def read_views(views):
    """Entry, direction, up (V, R, 3), ratio, coverage, luminance (V, R), float32, of stored views (V, R, 12)."""
    voxels, count = views.shape[:2]
    entry, direction = np.empty((voxels, count, 3), np.float32), np.empty((voxels, count, 3), np.float32)
    up, ratio = np.empty((voxels, count, 3), np.float32), np.empty((voxels, count), np.float32)
    coverage, luminance = np.empty((voxels, count), np.float32), np.empty((voxels, count), np.float32)
    unit, signed = np.float32(UNIT), np.float32(SIGNED)
    for v in range(voxels):
        for r in range(count):
            for axis in range(3):
                entry[v, r, axis] = np.float32(views[v, r, axis]) / unit
                direction[v, r, axis] = np.float32(np.int16(views[v, r, 3 + axis])) / signed
                up[v, r, axis] = np.float32(np.int16(views[v, r, 6 + axis])) / signed
            ratio[v, r] = np.float32(views[v, r, 9]) / unit
            coverage[v, r] = np.float32(views[v, r, 10]) / np.float32(COVERAGE_SCALE)
            luminance[v, r] = np.float32(views[v, r, 11]) / unit
    return entry, direction, up, ratio, coverage, luminance


@device
def turn_views(vectors, luminance, turned, linear):
    """Turn entry, direction and up (V, R, 3) of views by the symmetry of their voxel, and change luminance (V, R).

    turned: numbers (V,) of symmetries, and these. linear: (V, 2) gain and offset of luminance.
    """
    entry, direction, up = vectors
    symmetry, symmetries = turned
    before, half = np.empty((3, 3), np.float32), np.float32(0.5)
    for v in range(entry.shape[0]):
        axis, sign = symmetries.axis[symmetry[v]], symmetries.sign[symmetry[v]]
        for r in range(entry.shape[1]):
            before[0], before[1], before[2] = entry[v, r], direction[v, r], up[v, r]
            for k in range(3):
                source, s = axis[k], sign[k]
                entry[v, r, k] = s * (before[0, source] - half) + half
                direction[v, r, k] = s * before[1, source]
                up[v, r, k] = s * before[2, source]
            luminance[v, r] = luminance[v, r] * linear[v, 0] + linear[v, 1]
