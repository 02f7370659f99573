# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendered frames that map networks learn from: G-buffer, pictures of several sample counts, and the reference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.errors import FileFormatError
from ....patchnet_addon.runtime.files import read_arrays, write_arrays
from ....patchnet_addon.runtime.progress import Steps
from ....patchnet_addon.sampling.strategy import Strategy
from ....patchnet_addon.sampling.trace import trace_view
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.supersample import supersample
from .gbuffer import LUMINANCE, NEEDS, gbuffer

KIND = "rendered-frame"
SIDES = (1, 2, 4, 8)  # of the pictures: side x side rays in each pixel
SUBPIXELS = 4  # parts along a pixel's side, each of (32 / 4)^2 of the reference's rays
_PART_SIDE = 8
_INPUTS = Strategy(
    "inputs", "Inputs", "The G-buffer, with nothing scored", NEEDS, lambda buffers: buffers.preview, "luminance", 1.0
)


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """Frame of H x W pixels, luminances linear in [0, 1], row 0 at the bottom.

    planes: (9, H, W) float32, see `gbuffer`. pictures: (4, H, W) float32 with SIDES^2 rays in each pixel.
    fine: (4H, 4W) float32; means over 4 x 4 are L32, the reference with 32 x 32 rays in each pixel (methods 7.5).
    """

    planes: np.ndarray
    pictures: np.ndarray
    fine: np.ndarray

    @classmethod
    def load(cls, path: Path, key: str) -> Self | None:
        """Frame of a file, mapped into memory; None if it is not there, damaged, or has another key."""
        try:
            arrays, metadata = read_arrays(path, KIND)
        except FileFormatError:
            return None
        return cls(**arrays) if metadata.get("key") == key else None

    def save(self, path: Path, key: str) -> None:
        """Write the frame; key: of everything that it depends on."""
        write_arrays(path, {"planes": self.planes, "pictures": self.pictures, "fine": self.fine}, {"key": key}, KIND)


def render_frame(octree: Octree, camera: Camera) -> Steps[RenderedFrame]:
    """Render what the networks learn from."""
    buffers = yield from trace_view(octree, camera, [_INPUTS], reference=False)
    planes = gbuffer(buffers)
    pictures = [planes[LUMINANCE]]
    for side in SIDES[1:]:
        pictures.append(buffers.picture((yield from supersample(octree, camera, side))))
    # The same rays as those of the reference, kept by parts of the pixels: a part's eighth is a pixel's 32nd.
    larger = camera.with_size(SUBPIXELS * camera.width_px, SUBPIXELS * camera.height_px)
    fine = (yield from supersample(octree, larger, _PART_SIDE)).reshape(larger.height_px, larger.width_px)
    return RenderedFrame(planes, np.stack(pictures), fine)
