# SPDX-License-Identifier: GPL-3.0-or-later
"""Trace pixel buffers from octree and camera: all inputs of the chosen strategies."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..octree.octree import Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.errors import SettingError
from ..runtime.progress import Progress, Steps
from ..tracing.camera import Camera
from ..tracing.pixel_filter import BOX_FILTER, PixelFilter
from .pixel_buffers import PixelBuffers
from .predicted import PREDICTED, PREVIEW
from .strategy import (
    BEHIND,
    CHILD_MASK,
    EXACT,
    EXACT_1,
    FINE,
    FINE_RAYS,
    NORMAL,
    PREDICTION,
    REFERENCE,
    Strategy,
)

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree
    from ..tracing.pixel_means import PixelMeans


def trace_view(
    octree: Octree,
    camera: Camera,
    strategies: Iterable[Strategy],
    *,
    coded: CodedOctree | None = None,
    reference: bool = True,
    lookahead: int | None = None,
    unrefined: str = PREVIEW,
    pixel_filter: PixelFilter = BOX_FILTER,
) -> Steps[PixelBuffers]:
    """Picture at 1 sample per pixel, further inputs of `strategies`, and optionally the 32x32 reference.

    Pictures are in colour too if the octree is. lookahead: levels that the exact oracle and rays behind the patch look
    ahead, 1 to 3; None: those of the weights of `coded`, or two without codes.
    unrefined: picture in unrefined pixels, see `PixelBuffers`; inputs of the predicted picture are traced.
    pixel_filter: of the reference's colours and coverage; its luminance, which errors are of, has a box. Raises
    SettingError if a strategy, or the predicted picture, needs codes and `coded` is None, or if their weights look
    another number of levels ahead.
    """
    from ..codes.patch_rays import exact_prediction
    from ..codes.predict import predict
    from ..tracing.chosen import fine_rays
    from ..tracing.render import fine_hits, first_hits, seen_color
    from ..tracing.supersample import behind_patches
    from .plus.weights import estimators_of

    needs = frozenset[str]().union(*(strategy.needs for strategy in strategies))
    if unrefined == PREDICTED:
        needs |= {PREDICTION, BEHIND, FINE}
    lookahead = _lookahead(needs, coded, lookahead)
    yield Progress(0, 1, "Tracing the preview")
    traced = fine_hits(octree, camera, lookahead=lookahead) if FINE in needs else (first_hits(octree, camera), None)
    hits, fine = traced
    behind = behind_patches(octree, camera, hits, lookahead=lookahead) if BEHIND in needs else None
    colored = octree.chroma is not None
    prediction = predict(coded, hits) if PREDICTION in needs and coded is not None else None
    exact = (yield from exact_prediction(octree, hits, lookahead)) if EXACT in needs else None
    exact_1 = (yield from exact_prediction(octree, hits, 1)) if EXACT_1 in needs else None
    sampled = (yield from _reference(octree, camera, pixel_filter)) if reference or REFERENCE in needs else None
    return PixelBuffers(
        hits,
        behind=None if behind is None else behind.luminance,
        prediction=prediction,
        exact=exact,
        reference=None if sampled is None else sampled.luminance,
        preview_color=seen_color(octree, hits.node, hits.direction) if colored else None,
        reference_color=sampled.colors if sampled is not None and colored else None,
        reference_alpha=None if sampled is None else sampled.coverage,
        fine=fine,
        fine_rays=fine_rays(octree, camera, lookahead=lookahead) if FINE_RAYS in needs else None,
        exact_1=exact_1,
        normal=seen_normal(octree, hits.node) if NORMAL in needs else None,
        child_mask=seen_children(octree, hits.node) if CHILD_MASK in needs else None,
        cube_side_world=octree.grid.side_world,
        scene_luminance=float(octree.luminance_float(slice(1))[0]),
        behind_color=behind.colors if colored and behind is not None else None,
        behind_hit=None if behind is None else behind.coverage > 0.0,
        unrefined=unrefined,
        estimators=estimators_of(coded.weights) if coded is not None and coded.weights.plus else None,
    )


def _reference(octree: Octree, camera: Camera, pixel_filter: PixelFilter) -> Steps[PixelMeans]:
    """32 x 32 rays in each pixel; a box is the paper's own way, without light above white."""
    from ..tracing.supersample import supersample
    from .film import filtered

    box = pixel_filter == BOX_FILTER
    return (yield from supersample(octree, camera) if box else filtered(octree, camera, pixel_filter))


def _lookahead(needs: frozenset[str], coded: CodedOctree | None, lookahead: int | None) -> int:
    """Levels to look ahead; raises SettingError if codes are missing or do not match, see `trace_view`."""
    if PREDICTION in needs and coded is None:
        raise SettingError("Strategy or predicted picture needs the octree's patch codes: precompute them first")
    if lookahead is None:
        return DEFAULT_LOOKAHEAD if coded is None else coded.weights.lookahead
    if PREDICTION in needs and coded is not None and coded.weights.lookahead != lookahead:
        raise SettingError(
            f"The octree's codes look {coded.weights.lookahead} levels ahead, not {lookahead}: encode it with weights "
            "that look as far, or leave the look-ahead to the codes"
        )
    return lookahead


def seen_normal(octree: Octree, nodes: np.ndarray) -> np.ndarray:
    """Unit normals (N, 3) float32 of nodes (N,); 0 for -1 (no node), and where the normals in a voxel cancel."""
    met = nodes >= 0
    mean = np.zeros((len(nodes), 3), np.float32)
    mean[met] = octree.normal_float(nodes[met])
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    return np.divide(mean, length, out=mean, where=length > 0)


def seen_children(octree: Octree, nodes: np.ndarray) -> np.ndarray:
    """Child masks (N,) uint8 of nodes (N,), bit x + 2y + 4z; 0 for a leaf and for -1 (no node)."""
    return np.where(nodes >= 0, octree.child_mask[np.maximum(nodes, 0)], np.uint8(0))
