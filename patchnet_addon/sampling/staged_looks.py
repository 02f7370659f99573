# SPDX-License-Identifier: GPL-3.0-or-later
"""Closer looks at chosen pixels of a view: traced and decoded for them alone, or read from a view that has all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..octree.octree import Octree
from ..tracing.camera import Camera
from .pixel_buffers import PixelBuffers

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree
    from ..codes.predict import Prediction
    from ..tracing.render import Hits


class Looks(Protocol):
    """Closer looks at N pixels, given as indices (N,) int64; values are those of `PixelBuffers`."""

    def normals(self, hits: Hits, pixels: np.ndarray) -> np.ndarray:
        """(N, 3) float32, mean normals of the hit voxels, made unit length."""
        ...

    def child_masks(self, hits: Hits, pixels: np.ndarray) -> np.ndarray:
        """(N,) uint8, children of the hit voxels."""
        ...

    def behind(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Luminance (N,) float32 behind the patch, and whether something is met there (N,) bool."""
        ...

    def fine_rays(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 4) float32, luminances of 2x2 finer rays."""
        ...

    def prediction(self, hits: Hits, pixels: np.ndarray) -> Prediction:
        """Coverage and luminance that the network decodes, of N pixels."""
        ...


@dataclass(frozen=True, eq=False)
class TracedLooks:
    """Looks that trace and decode what they are asked for.

    coded: codes of the octree, None where nobody asks for a prediction. lookahead: levels. predicted: prediction of all
    pixels where there is one already.
    """

    octree: Octree
    camera: Camera
    coded: CodedOctree | None
    lookahead: int
    predicted: Prediction | None = None

    def normals(self, hits: Hits, pixels: np.ndarray) -> np.ndarray:
        """See `Looks`."""
        from .trace import node_normals

        return node_normals(self.octree, hits.node[pixels])

    def child_masks(self, hits: Hits, pixels: np.ndarray) -> np.ndarray:
        """See `Looks`."""
        from .trace import node_child_masks

        return node_child_masks(self.octree, hits.node[pixels])

    def behind(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Looks`."""
        from ..tracing.chosen import behind_of
        from ..tracing.render import seen_luminance

        nodes = behind_of(self.octree, self.camera, pixels, lookahead=self.lookahead)
        return seen_luminance(self.octree, nodes, 0.0), nodes >= 0

    def fine_rays(self, pixels: np.ndarray) -> np.ndarray:
        """See `Looks`."""
        from ..tracing.chosen import fine_rays_of

        return fine_rays_of(self.octree, self.camera, pixels, lookahead=self.lookahead)

    def prediction(self, hits: Hits, pixels: np.ndarray) -> Prediction:
        """See `Looks`."""
        from ..codes.predict import predict_pixels

        if self.predicted is not None:
            return self.predicted.part(pixels)
        assert self.coded is not None  # whoever plans stages asks for codes
        return predict_pixels(self.coded, hits, pixels)


@dataclass(frozen=True, eq=False)
class KnownLooks:
    """Looks that read what a view knows of all its pixels."""

    buffers: PixelBuffers

    def normals(self, hits: Hits, pixels: np.ndarray) -> np.ndarray:
        """See `Looks`."""
        assert self.buffers.normal is not None
        return self.buffers.normal[pixels]

    def child_masks(self, hits: Hits, pixels: np.ndarray) -> np.ndarray:
        """See `Looks`."""
        assert self.buffers.child_mask is not None
        return self.buffers.child_mask[pixels]

    def behind(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Looks`."""
        assert self.buffers.behind is not None and self.buffers.behind_hit is not None
        return self.buffers.behind[pixels], self.buffers.behind_hit[pixels]

    def fine_rays(self, pixels: np.ndarray) -> np.ndarray:
        """See `Looks`."""
        assert self.buffers.fine_rays is not None
        return self.buffers.fine_rays[pixels]

    def prediction(self, hits: Hits, pixels: np.ndarray) -> Prediction:
        """See `Looks`."""
        assert self.buffers.prediction is not None
        return self.buffers.prediction.part(pixels)
