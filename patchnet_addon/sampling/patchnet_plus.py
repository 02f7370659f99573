# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies of the error estimator, one for each cost (methods 12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .plus.forms import FORMS, Form
from .strategy import BEHIND, CHILD_MASK, CUBE_SIDE, FINE, FINE_RAYS, NORMAL, PREDICTION, SCENE_LUMINANCE, Strategy

if TYPE_CHECKING:
    from ..network.weights import Weights

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

    if name not in {strategy.name for strategy in STRATEGIES} or estimators_fit(weights):
        return None
    learned = estimators_of(weights).metadata.get("patchnet")
    return (
        f"Strategy {name} expects the errors of other PatchNet weights ({learned}) than those in use ({weights.hash}), "
        "so its priorities may be worse: choose Strategy: PatchNet Behind, or weights that "
        "patchnet lab train-plus has written"
    )


@dataclass(frozen=True)
class _ExpectedError:
    """Score of a strategy, which pickle takes: expected errors by forms for the preview and the predicted picture."""

    form: str
    predicted: str

    def __call__(self, buffers: PixelBuffers) -> np.ndarray:
        from .plus.weights import shipped_estimators
        from .plus_planes import estimated_error  # compiled code, which registration must not load

        form = FORMS[self.predicted if buffers.shows_predicted else self.form]
        return estimated_error(buffers, buffers.estimators or shipped_estimators(), form)


def estimator_strategy(form: Form, predicted: Form | None, name: str, title: str, description: str) -> Strategy:
    """Strategy that ranks by the expected error of the picture that is shown.

    form: estimates errors of the preview. predicted: form for the predicted picture; None: always the preview.
    """
    return Strategy(
        name=name,
        title=title,
        description=description,
        needs=_GEOMETRY | _TRACED[form.rays] | ({PREDICTION} if form.network else set()),
        score=_ExpectedError(form.name, (predicted or form).name),
        quantity="expected luminance error",
        maximum=0.5,
        group="network" if form.network else "rays" if form.rays else "screen-space",
        extra_rays=_EXTRA_RAYS[form.rays],
    )


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
