# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of weights on samples of a scene: coverage and luminance, as a whole, by level and by pixel-voxel ratio."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.errors import SettingError
from ..data.dataset import Dataset
from ..data.samples import UNIT
from ..network.patchnet import PatchNet
from .validation import all_of, predicted_views

_RATIOS = 0.5, 0.625, 0.75, 0.875, 1.0


def weights_errors(weights: Weights, dataset: Dataset, voxels: int) -> dict[str, Any]:
    """Errors of the first `voxels` of a data set, plain JSON values: `all`, by `level`, by `ratio`.

    Each has `views`, mean absolute `coverage` and `luminance`, the luminance error of `voxel_luminance`, what the voxel
    shows without a network, `luminance_ratio` of these two, and mean squares: `coverage_squared`, and
    `luminance_squared_ratio` over views weighted by coverage. Raises SettingError where samples and weights look
    another number of levels ahead.
    """
    if weights.lookahead != dataset.lookahead:
        raise SettingError(
            f"{dataset.name} looks {dataset.lookahead} levels ahead, the weights {weights.lookahead}: draw the samples "
            f"with --lookahead {weights.lookahead}"
        )
    corpus = all_of(dataset, nearby=weights.kind.mixes)
    found = np.stack(predicted_views(PatchNet(weights), corpus, voxels))  # (5, N)
    views = corpus.views.shape[1]
    level = np.repeat(corpus.voxel[:voxels, 0], views)
    ratio = corpus.views[:voxels, :, 9].ravel() / UNIT
    bins = {f"{low} to {high}": (ratio >= low) & (ratio <= high) for low, high in itertools.pairwise(_RATIOS)}
    return {
        "all": _errors(found),
        "level": {str(one): _errors(found[:, level == one]) for one in np.unique(level)},
        "ratio": {name: _errors(found[:, chosen]) for name, chosen in bins.items() if chosen.any()},
    }


def _errors(found: np.ndarray) -> dict[str, float | None]:
    """Errors of views (5, N), N > 0; luminance counts where something is seen, and is 0 where nothing is.

    The ratios to the voxel's own errors are None where those are 0.
    """
    coverage, luminance, guess, target, own = found.astype(np.float64)
    seen = coverage > 0
    ours, voxels = (target - luminance)[seen], (own - luminance)[seen]
    weight = coverage[seen]
    return {
        "views": len(coverage),
        "coverage": _rounded(np.abs(guess - coverage).mean()),
        "coverage_squared": _rounded(np.square(guess - coverage).mean()),
        "luminance": _rounded(np.abs(ours).sum() / max(len(ours), 1)),
        "voxel_luminance": _rounded(np.abs(voxels).sum() / max(len(voxels), 1)),
        "luminance_ratio": _ratio(np.abs(ours).sum(), np.abs(voxels).sum()),
        "luminance_squared_ratio": _ratio((weight * ours**2).sum(), (weight * voxels**2).sum()),
    }


def _ratio(ours: float, voxels: float) -> float | None:
    return _rounded(ours / voxels) if voxels > 0 else None


def _rounded(value: float) -> float:
    return round(float(value), 6)
