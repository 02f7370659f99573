# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample positions within texels, as barycentric weights: origins of a texel's paths."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts


@dataclass(frozen=True, eq=False)
class BatchTexels:
    """Texels of an atlas that belong to triangles of one batch.

    texels: (n,) int64 of all pages. triangles: (n,) int64 in the batch. corners: (T, 3, 2) float64 of the batch's
    triangles on their pages (`Charts.corner_texels`), whose side is `page_side`.
    """

    texels: np.ndarray
    triangles: np.ndarray
    corners: np.ndarray
    page_side: int

    def __len__(self) -> int:
        return len(self.texels)

    def only(self, chosen: np.ndarray) -> BatchTexels:
        """Select some of the texels, by a mask (n,) or by indices."""
        return replace(self, texels=self.texels[chosen], triangles=self.triangles[chosen])


def texel_places(own: BatchTexels, *, side: int = 1, spread: float = 1.0) -> np.ndarray:
    """Weights (n, side * side, 2) float32 of corners 1 and 2 of the triangle at places in each texel.

    Places are the centres of side x side equal parts of a square of width `spread` around the texel's centre, column by
    column; those outside the triangle are moved into it.
    """
    out = np.empty((len(own), side * side, 2), np.float32)
    run_parts(_places, len(own), (own.texels, own.triangles, own.corners), own.page_side, (side, spread), out)
    return out


@device
def texel_frame(texel, corners, page_side):  # type: ignore[no-untyped-def]
    """Offset of a texel's lower left from a triangle's first corner, (2,), edges to the others, (2,) each, and area."""
    left = texel % page_side - corners[0, 0]
    low = texel // page_side % page_side - corners[0, 1]
    one_x = corners[1, 0] - corners[0, 0]
    one_y = corners[1, 1] - corners[0, 1]
    two_x = corners[2, 0] - corners[0, 0]
    two_y = corners[2, 1] - corners[0, 1]
    return left, low, one_x, one_y, two_x, two_y, one_x * two_y - one_y * two_x


@device
def place_in_texel(frame, i, j, side, spread):  # type: ignore[no-untyped-def]
    """Weights of corners 1 and 2 at the place (i, j) of side x side."""
    left, low, one_x, one_y, two_x, two_y, area = frame
    x = left + 0.5 + ((i + 0.5) / side - 0.5) * spread
    y = low + 0.5 + ((j + 0.5) / side - 0.5) * spread
    one = max((x * two_y - y * two_x) / area, 0.0)
    two = max((one_x * y - one_y * x) / area, 0.0)
    beyond = max(one + two, 1.0)
    return one / beyond, two / beyond


@kernel
def _places(first, last, own, page_side, square, out):  # type: ignore[no-untyped-def]
    """Write the weights of some texels. square: parts along its side, and its width."""
    texels, triangles, corners = own
    side, spread = square
    for index in range(first, last):
        frame = texel_frame(texels[index], corners[triangles[index]], page_side)
        for i in range(side):
            for j in range(side):
                one, two = place_in_texel(frame, i, j, side, spread)
                out[index, i * side + j, 0] = one
                out[index, i * side + j, 1] = two
