# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of an evaluation as plain JSON values: curves with intervals, costs, and the paper's claims."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...patchnet_addon.octree.file import octree_hash
from ...patchnet_addon.sampling.uniform import SIDES
from .bootstrap import Bootstrap, finite, number_with_interval
from .claims import claims_of, generalisation_of
from .curves import BUDGETS, OPTIMAL, TrackErrors, excess_area, pooled_mse
from .evaluate import SceneResult
from .picture_metrics import QUALITY_BUDGETS, QUALITY_NAMES, QUALITY_STRATEGIES
from .strategies import PatchNetwork

POOLED = "all scenes"
PREDICTED_RAYS = 2  # per pixel: its own, and the one behind the patch


def results_of(
    scenes: Sequence[SceneResult], networks: Sequence[PatchNetwork] = (), *, resamples: int = 2000
) -> dict[str, Any]:
    """Results of scenes and of all pooled; networks: for generalisation. Raises SettingError for a single frame."""
    tracks = [scene.frames.track(scene.name, tuple(scene.strategies)) for scene in scenes]
    draws = {track.scene: Bootstrap.of([track], resamples) for track in tracks}
    results: dict[str, Any] = {
        "scenes": {
            scene.name: _scene(scene, track, draws[scene.name]) for scene, track in zip(scenes, tracks, strict=True)
        }
    }
    if len(tracks) > 1:
        draws[POOLED] = Bootstrap.of(tracks, resamples)
        results["pooled"] = _curves(tracks, draws[POOLED])
    groups = {name: strategy.group for scene in scenes for name, strategy in scene.strategies.items()}
    claims = claims_of(draws, groups)
    if networks:
        octrees = {name: values["octree_hash"] for name, values in results["scenes"].items()}
        claims["generalisation"] = generalisation_of(draws, networks, octrees)
    return results | {"networks": {network.name: _network(network) for network in networks}, "claims": claims}


def _network(network: PatchNetwork) -> dict[str, Any]:
    """Description of a network by its weights."""
    return {
        "weights_hash": network.hash,
        "sample_passes": network.sample_passes,
        "octrees": sorted(network.octrees),
    }


def _scene(scene: SceneResult, track: TrackErrors, draws: Bootstrap) -> dict[str, Any]:
    frames, costs = scene.frames, scene.costs
    active = max(int(frames.active.sum()), 1)
    return _curves([track], draws) | {
        "frames": len(frames.active),
        "active_pixels": int(frames.active.sum()),
        "lookahead_share": float(frames.ahead.sum() / max(frames.hits.sum(), 1)),
        "depth": scene.coded.octree.depth,
        "nodes": scene.coded.octree.node_count,
        "octree_hash": octree_hash(scene.coded.octree),
        "rays_per_pixel": {name: 1 + strategy.extra_rays for name, strategy in scene.strategies.items()},
        "group": {name: strategy.group for name, strategy in scene.strategies.items()},
        **{name: costs[name] for name in ("ms_per_frame", "ms_by_budget", "reference_ms_per_pixel")},
        "quality": _quality(frames.quality),
        "uniform": {
            str(side): {
                "rays_per_pixel": side * side,
                "mse": float(frames.uniform[:, index].sum() / active),
                "ms_per_frame": costs["uniform_ms"][str(side)],
            }
            for index, side in enumerate(SIDES)
        },
        "predicted": {
            name: {
                "rays_per_pixel": PREDICTED_RAYS,
                "mse": curve[0],
                "mse_refined": curve,
                "ms_per_frame": milliseconds,
            }
            for curve, (name, milliseconds) in zip(
                (frames.predicted.sum(axis=0) / active).tolist(), costs["predicted_ms"].items(), strict=True
            )
        },
    }


def _quality(quality: np.ndarray) -> dict[str, Any]:
    """Means over frames of each picture metric, by strategy, at QUALITY_BUDGETS; None if it was not computed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of columns without a number
        means = np.nanmean(quality, axis=0)
    return {
        "budgets": list(QUALITY_BUDGETS),
        "metrics": {
            metric: {
                name: [finite(value) for value in means[row, :, column]] for row, name in enumerate(QUALITY_STRATEGIES)
            }
            for column, metric in enumerate(QUALITY_NAMES)
        },
    }


def _curves(tracks: Sequence[TrackErrors], draws: Bootstrap) -> dict[str, Any]:
    names = tracks[0].strategies
    mse = pooled_mse(tracks)
    areas = excess_area(mse, mse[names.index(OPTIMAL)])
    intervals = {name: draws.mse(name) for name in names}
    return {
        "budgets": BUDGETS.tolist(),
        "mse": {name: mse[row].tolist() for row, name in enumerate(names)},
        "intervals": {name: {"low": item.low.tolist(), "high": item.high.tolist()} for name, item in intervals.items()},
        "excess_area": {
            name: number_with_interval(draws.excess_area(name)) | {"value": finite(areas[row])}
            for row, name in enumerate(names)
        },
        "block_frames": list(draws.block_frames),
    }
