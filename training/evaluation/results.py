# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of an evaluation as plain JSON values: curves with intervals, costs, claims of the paper (methods 5)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...patchnet_addon.octree.file import octree_hash
from ...patchnet_addon.sampling.strategy import Group
from ...patchnet_addon.sampling.uniform import SIDES
from . import WITHOUT
from .bootstrap import Bootstrap, finite, number_with_interval
from .curves import BUDGETS, OPTIMAL, TrackErrors, excess_area, pooled_mse
from .evaluate import SceneResult
from .picture_metrics import QUALITY_NAMES, QUALITY_STRATEGIES
from .strategies import SCORES, PatchNetwork, strategy_name

POOLED = "all scenes"
PREDICTED_RAYS = 2  # per pixel: its own, and the one behind the patch
VARIANCE = "ss-variance"
LOWEST_FROM = 0.13
HALF = 0.5
_ORACLES = ("patchnet-exact", "patchnet-behind-exact")
"""The network's scores with exact patches, which separate errors of the network from those of the score."""
_REFERENCES = frozenset({"screen-space", "world-space"})
_NOT_IN_THE_PAPER = frozenset({"random", "ss-variance-hits", "ws-lut-coverage", "ss-unet", "plain-plus-0"})
BUDGET = 0.3


def results_of(scenes: Sequence[SceneResult], networks: Sequence[PatchNetwork]) -> dict[str, Any]:
    """Results of scenes and of all pooled; networks: for generalisation. Raises SettingError for a single frame."""
    tracks = [TrackErrors(tuple(scene.strategies), scene.frames.active, scene.frames.left) for scene in scenes]
    draws = {scene.name: Bootstrap.of([track]) for scene, track in zip(scenes, tracks, strict=True)}
    results: dict[str, Any] = {
        "scenes": {
            scene.name: _scene(scene, track, draws[scene.name]) for scene, track in zip(scenes, tracks, strict=True)
        }
    }
    if len(tracks) > 1:
        draws[POOLED] = Bootstrap.of(tracks)
        results["pooled"] = _curves(tracks, draws[POOLED])
    groups = {name: strategy.group for scene in scenes for name, strategy in scene.strategies.items()}
    claims = claims_of(draws, groups)
    if networks:
        octrees = {name: values["octree_hash"] for name, values in results["scenes"].items()}
        claims["generalisation"] = generalisation_of(draws, networks, octrees)
    described = {
        each.name: {"weights_hash": each.hash, "sample_passes": each.sample_passes, "octrees": sorted(each.octrees)}
        for each in networks
    }
    return results | {"networks": described, "claims": claims}


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
        **{name: costs[name] for name in ("ms_per_frame", "reference_ms_per_pixel")},
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
            name: {"rays_per_pixel": PREDICTED_RAYS, "mse": error, "ms_per_frame": milliseconds}
            for error, (name, milliseconds) in zip(
                (frames.predicted.sum(axis=0) / active).tolist(), costs["predicted_ms"].items(), strict=True
            )
        },
    }


def _quality(quality: np.ndarray) -> dict[str, Any]:
    """Means over frames of each picture metric, by strategy; None if it was not computed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of columns without a number
        means = np.nanmean(quality, axis=0)
    return {
        metric: {name: finite(value) for name, value in zip(QUALITY_STRATEGIES, column, strict=True)}
        for metric, column in zip(QUALITY_NAMES, means.T, strict=True)
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
        "excess_area": {name: finite(areas[row]) for row, name in enumerate(names)},
    }


def claims_of(draws: Mapping[str, Bootstrap], groups: Mapping[str, Group]) -> dict[str, Any]:
    """Claims by name, each with its results by scene and strategy, with intervals (methods 5).

    lowest: the strategy is below all references of the paper from a budget on, which should be 13 % at most;
    share_of_budgets: share of the budgets from 13 % on at which it is. half: at 30 % the strategy leaves half of the
    error of screen-space variance. Both are tested for all strategies of the network and for the exact oracles of their
    scores. groups: of the strategies in use, by name.
    """
    return {
        "lowest": {scene: _lowest(draw, groups) for scene, draw in draws.items()},
        "half": {scene: _half(draw, groups) for scene, draw in draws.items()},
    }


def _lowest(draw: Bootstrap, groups: Mapping[str, Group]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    # Strategies that the paper compares with: they use the screen or the octree, without further rays.
    others = [name for name in draw.strategies if groups[name] in _REFERENCES and name not in _NOT_IN_THE_PAPER]
    if not others:
        return found
    errors = np.array([draw.mse(other).value for other in others])
    for name in _asked(draw, groups):
        interval = draw.crossing(name, others)
        lowest = np.asarray(draw.mse(name).value) < errors.min(axis=0)
        found[name] = number_with_interval(interval) | {
            "holds": bool(interval.value <= LOWEST_FROM),
            "share_of_budgets": float(lowest[(BUDGETS >= LOWEST_FROM) & (BUDGETS < 1)].mean()),
        }
    return found


def _asked(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies of the network, then the exact oracles measured beside them."""
    networks = [name for name in draw.strategies if groups[name] == "network"]
    return [*networks, *(name for name in _ORACLES if name in draw.strategies)]


def _half(draw: Bootstrap, groups: Mapping[str, Group]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in [*_asked(draw, groups), *(name for name in draw.strategies if groups[name] == "rays")]:
        interval = draw.ratio(name, VARIANCE, BUDGET)
        found[name] = number_with_interval(interval) | {"holds": bool(interval.value <= HALF)}
    return found


def generalisation_of(
    draws: Mapping[str, Bootstrap], networks: Sequence[PatchNetwork], octrees: Mapping[str, str]
) -> dict[str, Any]:
    """Errors of networks over that of screen-space variance at BUDGET on every scene, by score, with intervals.

    draws: of each scene. octrees: hash of each scene's. Found: {score: {network: {scene: {value, low, high, seen}}}},
    None where the variance leaves no error.
    """
    return {
        score: {
            network.name: {
                scene: number_with_interval(draws[scene].ratio(strategy_name(network.name, score), VARIANCE, BUDGET))
                | {"seen": seen(network, scene, octree)}
                for scene, octree in octrees.items()
            }
            for network in networks
        }
        for score in SCORES
    }


def seen(network: PatchNetwork, scene: str, octree: str) -> bool:
    """Return whether a scene, by the hash of its octree, was in a network's training, by its name or its weights."""
    if network.name.startswith(WITHOUT):
        named = scene != network.name.removeprefix(WITHOUT)
    else:
        named = scene == network.name
    return named or octree in network.octrees
