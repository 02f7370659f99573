# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies of the error estimator, one for each cost (methods 12), and the fastest in stages (methods 12.5).

A plan of stages assigns forms of the estimator to pixels by their distance from the budget's cut.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .plus.forms import FORMS, Form
from .staged_strategy import SUFFIX, Plan, Stage, in_stages
from .strategy import BEHIND, CHILD_MASK, CUBE_SIDE, FINE, FINE_RAYS, NORMAL, PREDICTION, SCENE_LUMINANCE, Strategy

if TYPE_CHECKING:
    from ..network.weights import Weights

_NETWORK_FROM = 0.25  # budget: below it, rays behind and decoding cost more than the samples they save
_AROUND_FROM = 0.07  # budget: below it, the largest differences of the finer ray come first in any order
_ALL_FROM = 0.75  # budget: from here on nearly all pixels are near the cut or before it
_EVERY_PIXEL = 0.0, math.inf

_GEOMETRY = frozenset({NORMAL, CHILD_MASK, CUBE_SIDE, SCENE_LUMINANCE})
NEEDS = _GEOMETRY | {PREDICTION, BEHIND, FINE, FINE_RAYS}  # of all forms
_TRACED = {0: frozenset[str](), 1: frozenset({FINE, BEHIND}), 4: frozenset({FINE_RAYS, BEHIND})}
_EXTRA_RAYS = {0: 0, 1: 1, 4: 5}  # the finer ray in the pixel's centre also continues behind the patch


def estimators_fit(weights: Weights) -> bool:
    """Return whether the estimator that goes with PatchNet's weights has learned from their outputs."""
    from .plus.weights import estimators_of

    return bool(estimators_of(weights).metadata.get("patchnet") == weights.hash)


def estimators_warning(name: str, weights: Weights) -> str | None:
    """Warning for a strategy whose estimator was trained on outputs of other weights; None for all others.

    name: of the strategy. weights: PatchNet weights in use.
    """
    from .plus.weights import estimators_of

    if name.removesuffix(SUFFIX) not in {strategy.name for strategy in STRATEGIES} or estimators_fit(weights):
        return None
    learned = estimators_of(weights).metadata.get("patchnet")
    return (
        f"Strategy {name} expects the errors of other PatchNet weights ({learned}) than those in use ({weights.hash}), "
        "so its priorities may be worse: choose Strategy: PatchNet Behind, or weights that "
        "patchnet lab train-plus has written"
    )


def estimator_strategy(form: Form, predicted: Form | None, name: str, title: str, description: str) -> Strategy:
    """Strategy that ranks by the expected error of the picture that is shown.

    form: estimates errors of the preview. predicted: form for the predicted picture; None: always the preview.
    """

    def score(buffers: PixelBuffers) -> np.ndarray:
        from .plus.weights import shipped_estimators
        from .plus_planes import estimated_error  # compiled code, which registration must not load

        chosen = predicted if predicted is not None and buffers.shows_predicted else form
        return estimated_error(buffers, buffers.estimators or shipped_estimators(), chosen)

    return Strategy(
        name=name,
        title=title,
        description=description,
        needs=_GEOMETRY | _TRACED[form.rays] | ({PREDICTION} if form.network else set()),
        score=score,
        quantity="expected luminance error",
        maximum=0.5,
        group="network" if form.network else "rays" if form.rays else "screen-space",
        extra_rays=_EXTRA_RAYS[form.rays],
    )


def plan_of(last: Form) -> Callable[[float], Plan]:
    """Plan for a budget, with a last form of one finer ray or of four; it is the only one where the budget is large."""

    def plan(budget: float) -> Plan:
        if budget >= _ALL_FROM:
            return Plan((Stage(last, *_EVERY_PIXEL),))
        return _FOUR_RAYS if last.rays == 4 else _one_ray(last, budget)

    return plan


def _one_ray(last: Form, budget: float) -> Plan:
    """Plan with one finer ray; `last`, which also traces behind the patch, takes part where it is worth its time."""
    near = Stage(FORMS["fine-1"], 0.5, 1.3 + 5.0 * budget)
    stages = (near, Stage(last, 0.7, 1.2)) if budget >= _NETWORK_FROM else (near,)
    return Plan(stages, around=budget >= _AROUND_FROM)


# The predicted picture needs the finer ray and the one behind anyway.
STRATEGIES = (
    estimator_strategy(
        FORMS["plus-4"],
        FORMS["predicted-4"],
        "patchnet-plus",
        "PatchNet Plus",
        "Expected error by the network and five further rays per pixel; leaves the least error, choose it by default",
    ),
    estimator_strategy(
        FORMS["plus-1"],
        FORMS["predicted-1"],
        "patchnet-plus-1",
        "PatchNet Plus, one ray",
        "Expected error by the network and one further ray per pixel; choose it for faster previews",
    ),
    estimator_strategy(
        FORMS["plus-0"],
        FORMS["predicted-1"],
        "patchnet-plus-0",
        "PatchNet Plus, no ray",
        "Expected error by the network without further rays; choose it where every ray is expensive",
    ),
)

# Four finer rays for the pixels near the cut. The network adds less to them than decoding costs.
_FOUR_RAYS = Plan((Stage(FORMS["fine-1"], *_EVERY_PIXEL), Stage(FORMS["fine-4"], 0.4, 1.8)), around=False)

STAGED = in_stages(STRATEGIES[0], plan_of(FORMS["plus-4"]))
