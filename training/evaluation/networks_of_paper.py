# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks of the paper's comparison: of each scene, without one, by look-ahead and by encoder; no torch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...patchnet_addon.network.encoders import MLP
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD, LOOKAHEADS
from ...patchnet_addon.runtime.errors import SettingError
from ..encoders import ENCODERS
from . import WITHOUT

SCENE, WITHOUT_ONE, LOOK_AHEAD, ENCODER = KINDS = ("scene", "without", "look-ahead", "encoders")


@dataclass(frozen=True)
class NetworkPlan:
    """Network to train, with the names of its training scenes and of its encoder."""

    name: str
    scenes: tuple[str, ...]
    encoder: str = MLP.name
    lookahead: int = DEFAULT_LOOKAHEAD


def planned_networks(scenes: Sequence[str], kinds: Sequence[str], unseen: str | None = None) -> list[NetworkPlan]:
    """Networks of these kinds for scenes, in the order of training, without duplicates.

    kinds: "scene": one of each scene alone, named after it. "without": one of all but each scene, without-SCENE.
    "look-ahead": look-ahead-1 and look-ahead-3, "encoders": one named after each other encoder; both are trained on all
    scenes but `unseen` (the last one), and include without-UNSEEN for comparison. Raises SettingError for an unknown
    kind or scene, duplicate scenes, and without a scene to hold out.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise SettingError(f"Unknown kind of networks '{kind}': choose from {', '.join(KINDS)}")
    twice = [scene for scene in scenes if list(scenes).count(scene) > 1]
    if twice:
        raise SettingError(f"Scene {twice[0]!r} is named twice: name each scene once")
    if set(kinds) - {SCENE} and len(scenes) < 2:
        raise SettingError("A single scene has no held-out scene: name two scenes at least")
    if unseen is not None and unseen not in scenes:
        raise SettingError(f"Scene {unseen!r} is not among the scenes: hold out one of {', '.join(scenes)}")
    plans = [NetworkPlan(scene, (scene,)) for scene in scenes if SCENE in kinds]
    plans += [_without(scene, scenes) for scene in scenes if WITHOUT_ONE in kinds]
    if LOOK_AHEAD in kinds or ENCODER in kinds:
        usual = _without(unseen or scenes[-1], scenes)
        plans += [] if usual in plans else [usual]
        others = [lookahead for lookahead in LOOKAHEADS if lookahead != usual.lookahead and LOOK_AHEAD in kinds]
        for each in others:
            plans.append(NetworkPlan(f"look-ahead-{each}", usual.scenes, lookahead=each))
        for name in [name for name in ENCODERS if name != MLP.name and ENCODER in kinds]:
            plans.append(NetworkPlan(name, usual.scenes, name))
    _check_names(plans)
    return plans


def _without(scene: str, scenes: Sequence[str]) -> NetworkPlan:
    return NetworkPlan(WITHOUT + scene, tuple(other for other in scenes if other != scene))


def _check_names(plans: Sequence[NetworkPlan]) -> None:
    names = [plan.name for plan in plans]
    for name in names:
        if names.count(name) > 1:
            raise SettingError(f"Two networks would be called {name!r}: rename the octree file of that scene")
