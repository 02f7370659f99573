# SPDX-License-Identifier: GPL-3.0-or-later
"""Uniform pictures, with equally many rays per pixel: rivals of previews and predicted pictures (methods 3.12b)."""

from __future__ import annotations

import numpy as np

from ..octree.octree import Octree
from ..runtime.progress import Steps
from ..tracing.camera import Camera
from .pixel_buffers import PixelBuffers

SIDES = (1, 2, 3, 4)  # rays per pixel side


def uniform_error(octree: Octree, camera: Camera, buffers: PixelBuffers, side: int) -> Steps[float]:
    """Squared error of a picture of side x side rays in each pixel, summed over active pixels; one ray is the preview.

    The view needs its reference.
    """
    from ..tracing.supersample import supersample

    assert buffers.reference is not None
    picture = buffers.preview if side == 1 else (yield from supersample(octree, camera, side)).luminance
    return float(((picture.astype(np.float64) - buffers.reference) ** 2)[buffers.active].sum())


def uniform_report(octree: Octree, camera: Camera, buffers: PixelBuffers) -> Steps[dict[str, float]]:
    """Mean squared errors over active pixels of the pictures of SIDES, by the side as text."""
    count, found = max(int(np.count_nonzero(buffers.active)), 1), {}
    for side in SIDES:
        found[str(side)] = (yield from uniform_error(octree, camera, buffers, side)) / count
    return found
