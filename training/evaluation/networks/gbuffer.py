# SPDX-License-Identifier: GPL-3.0-or-later
"""G-buffer of a view as planes (C, H, W): what a network may see of a pixel's centre ray (methods 3.9-3.11).

Scale of the planes, the same for all octrees: luminance is linear, in [0, 1]; distances are in sides of the octree's
cube; levels are shares of the deepest that there may be; ratios are as they are, in [1/2, 1]; child counts are eighths.
Normals stand in the frame of the pixel's own ray (right, up, towards the viewer; methods 7.14), so that nothing depends
on where north is, and are turned to the viewer, since surfaces here have two sides. A miss has the background's
luminance, and 0 in every other plane.
"""

from __future__ import annotations

import numpy as np

from ....patchnet_addon.octree.octree import POPCOUNT
from ....patchnet_addon.runtime.bounds import MAX_DEPTH
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.strategy import CHILD_MASK, CUBE_SIDE, NORMAL

NEEDS = frozenset({NORMAL, CHILD_MASK, CUBE_SIDE})
PLANES = (
    "luminance", "mask", "normal right", "normal up", "normal to viewer", "distance", "level", "ratio", "children"
)  # fmt: skip
LUMINANCE, MASK, NORMALS, DISTANCE, LEVEL, RATIO, CHILDREN = 0, 1, slice(2, 5), 5, 6, 7, 8


def gbuffer(buffers: PixelBuffers) -> np.ndarray:
    """Planes (9, H, W) float32 of a view, in the order of PLANES; the view must have what NEEDS names."""
    assert buffers.child_mask is not None and buffers.cube_side_world is not None  # NEEDS says so
    hits, hit = buffers.hits, buffers.hit
    planes = np.zeros((len(PLANES), len(hit)), np.float32)
    planes[LUMINANCE] = buffers.preview
    planes[MASK] = hit
    planes[NORMALS] = _normals(buffers)
    planes[DISTANCE] = np.where(hit, hits.t_world, 0.0) / buffers.cube_side_world
    planes[LEVEL] = hits.level / MAX_DEPTH
    planes[RATIO] = hits.ratio
    planes[CHILDREN] = POPCOUNT[buffers.child_mask] / 8
    planes[MASK:, ~hit] = 0.0
    return planes.reshape(len(PLANES), buffers.height, buffers.width)


def _normals(buffers: PixelBuffers) -> np.ndarray:
    """Normals (3, P) in the frames of the rays, turned to the viewer."""
    assert buffers.normal is not None
    forward, up = buffers.hits.direction, buffers.hits.up
    axes = np.stack([np.cross(forward, up), up, -forward])  # (3, P, 3)
    turned = np.einsum("apc,pc->ap", axes, buffers.normal)
    return np.where(turned[2] < 0.0, -turned, turned)
