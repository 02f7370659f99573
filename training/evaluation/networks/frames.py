# SPDX-License-Identifier: GPL-3.0-or-later
"""Training frames of map networks, and their input planes (methods 3.9-3.11).

Units of the planes (C, H, W) of a pixel's centre ray, the same for all octrees: luminance is linear, in [0, 1];
distances are in sides of the octree's cube; levels are shares of the maximum level; ratios are in [1/2, 1]; child
counts are eighths. Normals are in the frame of the pixel's ray (right, up, towards the viewer; methods 7.14), so that
planes are independent of the heading, and face the viewer, since surfaces have two sides. A miss has the background's
luminance, and 0 in every other plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....patchnet_addon.cells.morton import POPCOUNT
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.bounds import MAX_DEPTH
from ....patchnet_addon.runtime.progress import Steps
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.strategy import CHILD_MASK, CUBE_SIDE, NORMAL, Strategy
from ....patchnet_addon.sampling.trace import trace_view
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.supersample import supersample

NEEDS = frozenset({NORMAL, CHILD_MASK, CUBE_SIDE})
PLANES = (
    "luminance", "mask", "normal right", "normal up", "normal to viewer", "distance", "level", "ratio", "children"
)  # fmt: skip
LUMINANCE, MASK, NORMALS, DISTANCE, LEVEL, RATIO, CHILDREN = 0, 1, slice(2, 5), 5, 6, 7, 8
KIND = "rendered-frame"
SIDES = (1, 2, 4, 8)  # of the pictures: side x side rays in each pixel
SUBPIXELS = 4  # parts along a pixel's side, each of (32 / 4)^2 of the reference's rays
_PART_SIDE = 8
_INPUTS = Strategy(
    "inputs", "Inputs", "G-buffer without a score", NEEDS, lambda buffers: buffers.preview, "luminance", 1.0
)


def gbuffer(buffers: PixelBuffers) -> np.ndarray:
    """Planes (9, H, W) float32 of a view, in the order of PLANES; the view must have everything in NEEDS."""
    assert buffers.child_mask is not None and buffers.cube_side_world is not None  # required by NEEDS
    assert buffers.normal is not None
    hits, hit = buffers.hits, buffers.hit
    planes = np.zeros((len(PLANES), len(hit)), np.float32)
    planes[LUMINANCE] = buffers.preview
    planes[MASK] = hit
    # Normals in the frames of the rays, facing the viewer.
    axes = np.stack([np.cross(hits.direction, hits.up), hits.up, -hits.direction])  # (3, P, 3)
    turned = np.einsum("apc,pc->ap", axes, buffers.normal)
    planes[NORMALS] = np.where(turned[2] < 0.0, -turned, turned)
    planes[DISTANCE] = np.where(hit, hits.t_world, 0.0) / buffers.cube_side_world
    planes[LEVEL] = hits.level / MAX_DEPTH
    planes[RATIO] = hits.ratio
    planes[CHILDREN] = POPCOUNT[buffers.child_mask] / 8
    planes[MASK:, ~hit] = 0.0
    return planes.reshape(len(PLANES), buffers.height, buffers.width)


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """Frame of H x W pixels, luminances linear in [0, 1], row 0 at the bottom.

    planes: (9, H, W) float32, see `gbuffer`. pictures: (4, H, W) float32 with SIDES^2 rays in each pixel.
    fine: (4H, 4W) float32; means over 4 x 4 are L32, the reference with 32 x 32 rays in each pixel (methods 7.5).
    """

    planes: np.ndarray
    pictures: np.ndarray
    fine: np.ndarray


def render_frame(octree: Octree, camera: Camera) -> Steps[RenderedFrame]:
    """Render the pictures and planes of a frame."""
    buffers = yield from trace_view(octree, camera, [_INPUTS], reference=False)
    planes = gbuffer(buffers)
    pictures = [planes[LUMINANCE]]
    for side in SIDES[1:]:
        pictures.append(buffers.picture((yield from supersample(octree, camera, side)).luminance))
    # The rays of the reference, grouped by parts of pixels: 1/8 of a part is 1/32 of a pixel.
    larger = camera.with_size(SUBPIXELS * camera.width_px, SUBPIXELS * camera.height_px)
    fine = (yield from supersample(octree, larger, _PART_SIDE)).luminance.reshape(larger.height_px, larger.width_px)
    return RenderedFrame(planes, np.stack(pictures), fine)
