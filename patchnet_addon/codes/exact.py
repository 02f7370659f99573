# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact oracle: coverage and luminance rendered from each pixel's patch instead of decoded (methods 9).

It is the limit of any network with this look-ahead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..octree.octree import Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD, LOOKAHEAD
from ..runtime.progress import Progress, Steps
from .patch_rays import PatchRays, render_patches
from .predict import Prediction

if TYPE_CHECKING:
    from ..tracing.render import Hits

_CHUNK = 16384


def exact_prediction(octree: Octree, hits: Hits, lookahead: int = DEFAULT_LOOKAHEAD) -> Steps[Prediction]:
    """Coverage and luminance of every pixel by 64x64 rays through its patch (methods 7.16, 7.17).

    lookahead: levels between a voxel and its patch's cells, 1 to 3: those of the compared weights. Raises SettingError
    for others.

    Pixels without look-ahead keep their preview, as in `predict`, so that their priority is 0 (methods 4.1b).
    """
    LOOKAHEAD.check(lookahead)
    ahead = octree.look_ahead(lookahead)
    look_ahead = hits.hit & ahead[np.maximum(hits.node, 0)]
    pixels = np.flatnonzero(look_ahead)
    pixels = pixels[np.argsort(hits.node[pixels], kind="stable")]  # a voxel's pixels share its brick
    coverage = np.ones(len(look_ahead), np.float32)
    luminance = hits.luminance.astype(np.float32)
    for start in range(0, len(pixels), _CHUNK):
        here = pixels[start : start + _CHUNK]
        coverage[here], seen = render_patches(octree, _patch_rays(hits, here), lookahead)
        luminance[here] = np.where(coverage[here] > 0, seen, luminance[here])
        yield Progress(start + len(here), len(pixels), "Rendering patches")
    return Prediction(coverage, luminance, look_ahead)


def _patch_rays(hits: Hits, pixels: np.ndarray) -> PatchRays:
    """Viewports of pixels (M,) sorted by node."""
    first = np.flatnonzero(np.diff(hits.node[pixels], prepend=-1))
    return PatchRays(
        level=hits.level[pixels[first]],
        cell=hits.cell[pixels[first]],
        group_start=np.append(first, len(pixels)),
        entry_voxel=hits.entry_voxel[pixels],
        direction=hits.direction[pixels],
        up=hits.up[pixels],
        ratio=hits.ratio[pixels],
    )
