# SPDX-License-Identifier: GPL-3.0-or-later
"""Predicted pictures of an evaluation's frames: errors, unrefined and refined, beside the paper's (methods 3.12b)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ...patchnet_addon.sampling import patchnet_behind
from ...patchnet_addon.sampling.errors import sum_left_after
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.predicted import PREDICTED
from ...patchnet_addon.sampling.refine import refinement_order
from .curves import BUDGETS
from .patch_networks import PatchNetwork


def predicted_names(networks: Sequence[PatchNetwork]) -> list[str]:
    """Names of the predicted pictures: by the weights of the evaluation, then by each further network."""
    return [PREDICTED, *(f"{PREDICTED}-{network.name}" for network in networks)]


def predicted_left(views: Iterable[PixelBuffers]) -> np.ndarray:
    """(N, 101) float64: squared error of N predicted pictures of a frame, summed over active pixels.

    It is what each budget of BUDGETS leaves by the picture's own priority. views: each with a prediction of its own,
    and the reference.
    """
    rows = []
    for view in views:
        buffers = replace(view, unrefined=PREDICTED)
        order = refinement_order(buffers, patchnet_behind.STRATEGY.scores(buffers))
        rows.append(sum_left_after(buffers, order, BUDGETS.tolist()))
    return np.array(rows, np.float64)
