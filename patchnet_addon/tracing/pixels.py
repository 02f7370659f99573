# SPDX-License-Identifier: GPL-3.0-or-later
"""Super-sampling of chosen pixels, so that refining some costs what these cost (methods 7.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..octree.octree import Octree
from ..runtime.bounds import RAYS
from .camera import Camera, camera_in_unit_cube
from .supersample import MAX_SIDE, MEANS, NO_CHROMA, block_order, mean_of_rays


@dataclass(frozen=True, eq=False)
class PixelMeans:
    """Means over side x side rays of N pixels, over a black background.

    luminance: (N,) float32, as `supersample` computes it. colors: (N, 3) float32 linear, gray without colour, with what
    is above white, which luminance is without.
    coverage: (N,) float32, share of the rays that met something.
    """

    luminance: np.ndarray
    colors: np.ndarray
    coverage: np.ndarray


def supersample_pixels(octree: Octree, camera: Camera, pixels: np.ndarray, side: int = MAX_SIDE) -> PixelMeans:
    """Pixels (N,) of `camera`, by their indices row * width + column, with side x side rays each.

    Each ray has the footprint pixel / side. Raises SettingError for sample counts outside 1 to 32.
    """
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid).finer(side)
    chroma = NO_CHROMA if octree.chroma is None else octree.chroma
    pixels = np.asarray(pixels, np.int64)
    order = block_order(pixels, camera.width_px, side)
    found = np.empty((len(pixels), MEANS), np.float32)
    light = octree.luminance, chroma, octree.above_white
    mean_of_rays(octree.boxed_nodes, light, unit, pixels[order], (side, 0.0, octree.depth), found)
    means = np.empty_like(found)
    means[order] = found
    return PixelMeans(means[:, 0].copy(), means[:, 1:4].copy(), means[:, 4].copy())
