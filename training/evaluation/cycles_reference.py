# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies measured against Cycles' renders of the scene instead of rays of its octree (truth G2, methods 7.28).

Refined pixels are the render's, unrefined ones the octree's with one ray each. Some error is then independent of
strategies: the octree with 32x32 rays per pixel (truth G1) differs from the render by the bias of voxels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.octree.file import octree_hash
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.sampling.strategy import REFERENCE, Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from .curves import BUDGETS, frame_errors, frame_orders

OCTREE, DIFFUSE, COMBINED = "octree", "diffuse", "combined"  # truths: G1, G2, and G2 with gloss and glass


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of refined pixels: luminance (P,) float32 in [0, 1], row 0 at the bottom.

    noise: (P,) float64, expected squared error of each pixel by the render's noise, from its two halves.
    """

    luminance: np.ndarray
    noise: np.ndarray

    @classmethod
    def of_halves(cls, first: np.ndarray, second: np.ndarray, exposure: float) -> Truth:
        """Mean of two renders (H, W) of half the samples each, exposed and clamped as the octree (methods 7.1).

        Its variance is a quarter of their mean squared difference, that of each half is one half.
        """
        clamped = [np.clip(exposure * half.ravel().astype(np.float64), 0.0, 1.0) for half in (first, second)]
        mean = np.clip(exposure * (first.ravel().astype(np.float64) + second.ravel()) / 2.0, 0.0, 1.0)
        return cls(mean.astype(np.float32), (clamped[0] - clamped[1]) ** 2 / 4.0)


class CameraResult(NamedTuple):
    """Results of one camera.

    active: number of active pixels. errors: against the octree and against each of the truths, by name, see
    `frame_errors`. bias, noise: sums over active pixels, by truth.
    """

    active: int
    errors: Mapping[str, np.ndarray]
    bias: Mapping[str, float]
    noise: Mapping[str, float]


def spread_cameras(track: Sequence[Camera], count: int) -> list[Camera]:
    """Cameras in the middle of `count` equal parts of a track; raises SettingError if it has fewer frames."""
    if count > len(track):
        raise SettingError(f"{count} cameras exceed the {len(track)} frames of a track: give fewer, or more --frames")
    cameras = [track[(2 * number + 1) * len(track) // (2 * count)] for number in range(count)]
    return [replace(camera, name=f"View {number}") for number, camera in enumerate(cameras, 1)]


def measure_camera(
    coded: CodedOctree, camera: Camera, strategies: Mapping[str, Strategy], truths: Mapping[str, Truth]
) -> Steps[CameraResult]:
    """Measure all strategies through one camera. Scores are the same for all truths, except of oracles."""
    buffers = yield from trace_view(coded.octree, camera, list(strategies.values()), coded=coded)
    assert buffers.reference is not None
    scores = {name: strategy.scores(buffers) for name, strategy in strategies.items()}
    errors = {OCTREE: frame_errors(buffers, frame_orders(buffers, scores))}
    bias, noise = {}, {}
    for name, truth in truths.items():
        seen = replace(buffers, reference=truth.luminance)
        known = {key: each.scores(seen) for key, each in strategies.items() if REFERENCE in each.needs}
        errors[name] = frame_errors(seen, frame_orders(seen, scores | known))
        off = (buffers.reference.astype(np.float64) - truth.luminance) ** 2
        bias[name], noise[name] = float(off[buffers.active].sum()), float(truth.noise[buffers.active].sum())
    return CameraResult(int(np.count_nonzero(buffers.active)), errors, bias, noise)


def cycles_results(
    coded: CodedOctree, strategies: Mapping[str, Strategy], results: Sequence[CameraResult]
) -> dict[str, Any]:
    """Results of a scene's cameras as plain JSON values: mean squared errors over all active pixels (methods 5).

    `mse` is against the diffuse light; `truths` has the same of each truth, with bias and noise.
    """
    active = max(sum(result.active for result in results), 1)
    truths: dict[str, Any] = {}
    for truth in results[0].errors:
        mse = np.sum([result.errors[truth] for result in results], axis=0) / active
        truths[truth] = {"mse": {name: mse[row].tolist() for row, name in enumerate(strategies)}}
        if truth != OCTREE:
            truths[truth] |= {
                "bias": sum(result.bias[truth] for result in results) / active,
                "noise": sum(result.noise[truth] for result in results) / active,
            }
    return {
        "budgets": BUDGETS.tolist(),
        "mse": truths[DIFFUSE]["mse"],
        "truths": truths,
        "active_pixels": active,
        "depth": coded.octree.depth,
        "octree_hash": octree_hash(coded.octree),
        "rays_per_pixel": {name: 1 + strategy.extra_rays for name, strategy in strategies.items()},
        "group": {name: strategy.group for name, strategy in strategies.items()},
    }
