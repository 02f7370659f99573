# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance that the pixels of a view have by painted strokes, on a picture or on a surface.

On a surface, the centre of a voxel that a pixel shows looks for the nearest painted triangle, no farther than the
voxel's corners. Blender's process has the triangles and finds them, so the engine asks it for their weights.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..octree.grid import Grid
from ..process.segments import shared_zeros
from ..runtime.progress import Progress, Steps
from .importance import PixelRect, beside_hits, picture_weights
from .pixel_buffers import PixelBuffers

_LABEL = "Looking up importance"
_HALF_DIAGONAL = 0.5 * 3.0**0.5 * 1.001  # in voxel sides, with a margin for rounding
_POLL_S = 0.002
_UNKNOWN = -1.0


class Lookup(NamedTuple):
    """Question for the weights of a painted surface, as `partial` of a report.

    centres: (n, 3) in world units. reaches: (n,), 0 counts as the weight where nothing is painted within. weights: (n,)
    float32, to be filled in; memory that both processes see.
    """

    centres: np.ndarray
    reaches: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True)
class Painted:
    """Weights of the pixels of an octree's view by painted strokes; called in the process that has the view.

    picture: (h, w) float32, row 0 at the bottom, stretched over the view, or over `rect`; None: strokes on a surface,
    whose weights the caller fills in when the steps report a `Lookup`.
    """

    grid: Grid
    picture: np.ndarray | None
    rect: PixelRect | None = None

    def __call__(self, buffers: PixelBuffers) -> Steps[np.ndarray]:
        """(P,) float32 in [0, 1]."""
        if self.picture is not None:
            return picture_weights(self.picture, buffers.height, buffers.width, self.rect)
        weights = yield from _surface_weights(self.grid, buffers)
        return beside_hits(buffers.picture(weights), buffers.picture(buffers.hit)).ravel()


def _surface_weights(grid: Grid, buffers: PixelBuffers) -> Steps[np.ndarray]:
    """(P,) float32: the weight of the surface in each pixel's voxel; 0 for a miss."""
    weights = np.zeros(len(buffers.preview), np.float32)
    pixels = np.flatnonzero(buffers.hit)
    nodes, pick, rows = np.unique(buffers.hits.node[pixels], return_index=True, return_inverse=True)
    levels, cells = buffers.hits.level[pixels][pick], buffers.hits.cell[pixels][pick]
    sides = np.exp2(-levels.astype(np.float64))[:, None]
    of_node = shared_zeros((len(nodes),), np.float32)
    of_node[:] = _UNKNOWN
    centres, reaches = grid.to_world((cells + 0.5) * sides), sides[:, 0] * grid.side_world * _HALF_DIAGONAL
    yield Progress(0, len(nodes), _LABEL, partial=Lookup(centres, reaches, of_node))
    while (known := int((of_node != _UNKNOWN).sum())) < len(nodes):
        yield Progress(known, len(nodes), _LABEL)
        time.sleep(_POLL_S)
    weights[pixels] = of_node[rows.reshape(-1)]
    return weights
