# SPDX-License-Identifier: GPL-3.0-or-later
"""Error detection over distance and look-ahead: views with the exact patches of one, two and three levels ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.bounds import LOOKAHEADS
from ....patchnet_addon.runtime.progress import Steps
from ....patchnet_addon.sampling.errors import sum_left_after
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.refine import refinement_order
from ....patchnet_addon.sampling.trace import trace_view
from ....patchnet_addon.tracing.camera import Camera
from ...strategies.registry import EVALUATED
from ..patterns import PATTERN_BUDGET
from .split import found_share

EXACT = ("patchnet-behind-exact", "patchnet-exact")  # the first is shown: its score is a luminance error
NETWORK = ("patchnet-behind", "patchnet")
PLAIN = ("ss-variance", "optimal")


@dataclass(frozen=True, eq=False)
class DistanceView:
    """View from one distance.

    scores: (P,) by strategy, those of EXACT and NETWORK with the number of levels that they look ahead behind a space.
    region: (P,) bool, pixels whose ray stops in the box that matters, or within a voxel of it. look_ahead: share of
    hits with real descendants so many levels down. voxel_world: side of the voxels that rays stop in, the median.
    """

    camera: Camera
    buffers: PixelBuffers
    scores: Mapping[str, np.ndarray]
    region: np.ndarray
    look_ahead: Mapping[int, float]
    voxel_world: float

    @property
    def error(self) -> np.ndarray:
        """(H, W) absolute luminance error of the preview."""
        assert self.buffers.reference is not None
        return self.buffers.picture(np.abs(self.buffers.preview - self.buffers.reference))


def named(strategy: str, lookahead: int) -> str:
    """Name of a strategy with its look-ahead."""
    return f"{strategy} {lookahead}"


def distance_view(
    octree: Octree, camera: Camera, box_world: np.ndarray, coded: Sequence[CodedOctree] = ()
) -> Steps[DistanceView]:
    """Trace a view with all look-aheads.

    box_world: (2, 3) corners of what matters. coded: octrees with the codes of networks that are shown as well.
    """
    plain = [EVALUATED[name] for name in PLAIN]
    buffers = yield from trace_view(octree, camera, plain)
    scores = {strategy.name: strategy.scores(buffers) for strategy in plain}
    hits = buffers.hits.node[buffers.hit]
    shares = {}
    for lookahead in LOOKAHEADS:
        yield from _add_scores(scores, EXACT, buffers, trace_view(
            octree, camera, [EVALUATED[name] for name in EXACT], reference=False, lookahead=lookahead
        ), lookahead)  # fmt: skip
        shares[lookahead] = float(octree.look_ahead(lookahead)[hits].mean()) if len(hits) else 0.0
    for each in coded:
        yield from _add_scores(scores, NETWORK, buffers, trace_view(
            octree, camera, [EVALUATED[name] for name in NETWORK], coded=each, reference=False
        ), each.weights.lookahead)  # fmt: skip
    levels = octree.level_of(hits)
    voxel = octree.grid.side_world * 2.0 ** -float(np.median(levels)) if len(levels) else float("nan")
    return DistanceView(camera, buffers, scores, _region(camera, buffers, box_world, voxel), shares, voxel)


def _region(camera: Camera, buffers: PixelBuffers, box_world: np.ndarray, margin_world: float) -> np.ndarray:
    hits = buffers.hits
    points = camera.position_world + hits.direction * np.where(hits.hit, hits.t_world, 0.0)[:, None]
    inside = (points >= box_world[0] - margin_world) & (points <= box_world[1] + margin_world)
    return np.asarray(hits.hit & inside.all(axis=1))


def _add_scores(
    scores: dict[str, np.ndarray],
    names: Sequence[str],
    seen: PixelBuffers,
    steps: Steps[PixelBuffers],
    lookahead: int,
) -> Steps[None]:
    """Score a view of another look-ahead; what a pixel shows is the same, so its reference is not rendered again."""
    buffers = replace((yield from steps), reference=seen.reference)
    for name in names:
        scores[named(name, lookahead)] = EVALUATED[name].scores(buffers)


def pooled_values(views: Sequence[DistanceView]) -> dict[str, Any]:
    """Figures of the views from one distance as plain JSON values, errors pooled over all of them.

    region: of the pixels of the region, whose budget is spent there alone. picture: of all active pixels.
    """
    hits = [int(np.count_nonzero(view.buffers.hit)) for view in views]
    return {
        "distance": float(np.mean([_distance(view) for view in views])),
        "voxel": views[0].voxel_world,
        "look_ahead_share": {
            str(levels): float(np.average([view.look_ahead[levels] for view in views], weights=hits))
            for levels in LOOKAHEADS
        },
        "region": _errors(views, [view.region & view.buffers.active for view in views]),
        "picture": _errors(views, [view.buffers.active for view in views]),
    }  # fmt: skip


def _distance(view: DistanceView) -> float:
    """Middle distance of the region along the line of sight, or else of what is hit, world units."""
    seen = view.region if view.region.any() else view.buffers.hit
    return float(np.median(view.buffers.hits.z_world[seen])) if seen.any() else float("nan")


def _errors(views: Sequence[DistanceView], masks: Sequence[np.ndarray]) -> dict[str, Any]:
    """Errors by strategy, before and after each view's budget within its mask (P,) bool."""
    pixels = max(sum(int(np.count_nonzero(mask)) for mask in masks), 1)
    before = _left(views, masks, PLAIN[0], 0.0) / pixels
    left = {name: _left(views, masks, name, PATTERN_BUDGET) / pixels for name in views[0].scores}
    variance = left[PLAIN[0]]
    found = {
        name: {
            "mse": mse,
            "found": found_share(before, mse),
            "over_ss_variance": mse / variance if variance > 0 else None,
        }
        for name, mse in left.items()
    }
    return {"pixels": pixels, "mse": before, "strategies": found}


def _left(views: Sequence[DistanceView], masks: Sequence[np.ndarray], name: str, budget: float) -> float:
    """Sum over views of the squared error that a budget leaves within the masks."""
    total = 0.0
    for view, mask in zip(views, masks, strict=True):
        order = refinement_order(view.buffers, view.scores[name])
        total += float(sum_left_after(view.buffers, order[mask[order]], [budget])[0])
    return total
