# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels of render passes, of a picture and of its traced view.

`operators/render_engine/passes.py` says what each pass is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..octree.octree import Octree
from .adaptive import AdaptivePicture
from .trace import seen_normal

if TYPE_CHECKING:
    from ..tracing.hits import Hits

NO_DEPTH = 1e10  # what Cycles writes


def combined(
    values: np.ndarray, exposure: float, world: np.ndarray | None, out: np.ndarray | None = None
) -> np.ndarray:
    """(P, 4) float32, premultiplied by alpha: light of an octree without its exposure, over `world`.

    values: (P, 4) of an `AdaptivePicture`. world: (3,), or (P, 3), one for each pixel; None: transparent.
    """
    pixels = np.empty(values.shape, np.float32) if out is None else out
    alpha = values[:, 3]
    pixels[:, 3] = alpha if world is None else 1.0
    open_share = 1.0 - alpha
    for channel in range(3):  # a fifth of the time of all channels at once; viewports call it again and again
        light = values[:, channel] / np.float32(exposure)
        if world is not None:
            light += open_share * world[..., channel]
        pixels[:, channel] = light
    return pixels


def traced_passes(picture: AdaptivePicture) -> dict[str, np.ndarray]:
    """Pixels (P, C) float32 of the passes that further rays do not change, of a traced picture, by name."""
    assert picture.buffers is not None
    hits = picture.buffers.hits
    values = {
        "Depth": np.where(hits.hit, hits.z_world, np.float32(NO_DEPTH)),
        "Normal": _normals(picture.octree, hits),
        "Level": np.where(hits.hit, hits.level, -1),
    }
    if picture.ranking is not None:
        predicted = picture.buffers.prediction
        coverage = hits.hit if predicted is None else np.where(hits.hit, predicted.coverage, np.float32(0.0))
        values |= {"Priority": picture.ranking.priority, "Coverage": coverage}
    return {name: value.astype(np.float32).reshape(len(hits.hit), -1) for name, value in values.items()}


def _normals(octree: Octree, hits: Hits) -> np.ndarray:
    """(P, 3) normals turned towards the camera as in Cycles, since sheets are seen from both sides."""
    normals = seen_normal(octree, hits.node)
    away = np.einsum("pc,pc->p", normals, hits.direction) > 0.0
    normals[away] *= -1.0
    return normals
