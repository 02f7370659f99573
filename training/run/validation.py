# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation: held-out scenes and held-out parts of training scenes, and errors on them (methods 7.21)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch

from ...patchnet_addon.network.torch_encode import float32_products
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.errors import SettingError
from ..data.augmentation import Augmentation
from ..data.corpus import Corpus
from ..data.dataset import Dataset, check_names, why_not_held_out
from ..data.forest import concatenate
from ..data.tensor_batch import tensor_batch
from ..network.patchnet import PatchNet
from ..settings import VALIDATION_VOXELS

_CHUNK = 512


def validate(model: PatchNet, corpus: Corpus, voxels: int = VALIDATION_VOXELS) -> dict[str, float | None]:
    """Errors of the first `voxels`, in float32 and clipped as at inference, plain JSON values.

    `views`, mean absolute `coverage` and `luminance`, that of `voxel_luminance`, the voxel's own luminance, which a
    pixel shows without a network, and of the best constants, `constant_coverage` and `constant_luminance`;
    `luminance_ratio` of luminance to the voxel's own; mean squares: `coverage_squared`, and `luminance_squared_ratio`
    over views weighted by coverage.
    """
    count = min(voxels, len(corpus.tree))
    chunks = np.split(np.arange(count), range(_CHUNK, count, _CHUNK))
    return _errors(np.concatenate([_predicted(model, corpus, rows) for rows in chunks], axis=1))


def _predicted(model: PatchNet, corpus: Corpus, rows: np.ndarray) -> np.ndarray:
    """True coverage and luminance, predicted ones, and the voxels' own luminance, (5, N), of voxels `rows`."""
    batch = corpus.batch(rows, Augmentation.none(len(rows)))
    with torch.no_grad(), float32_products(model.device):
        predicted = model(tensor_batch(batch, model.device)).clamp(0, 1).cpu().numpy()
    own = np.repeat(batch.own, corpus.views.shape[1])
    return np.stack([batch.coverage.ravel(), batch.luminance.ravel(), *predicted.reshape(-1, 2).T, own])


class ValidationSet(NamedTuple):
    """Voxels for validation; not_held_out: reason why their scene is not held out, or empty."""

    corpus: Corpus
    not_held_out: str


def validation_sets(
    parts: Mapping[str, Corpus],
    training: Sequence[Dataset],
    validation: Sequence[Dataset],
    lookahead: int,
    *,
    nearby: bool = False,
) -> dict[str, ValidationSet]:
    """Validation sets by name: all of `validation`, then the held-out `parts` of `training` by data set.

    nearby: as in `Corpus`. Raises SettingError for duplicate names, and for another look-ahead than that of training.
    """
    check_names(dataset.name for dataset in (*training, *validation))
    sets = {}
    for dataset in validation:
        if dataset.lookahead != lookahead:
            raise SettingError(
                f"{dataset.name} looks {dataset.lookahead} levels ahead, training {lookahead}: draw it with those"
            )
        sets[dataset.name] = ValidationSet(all_of(dataset, nearby=nearby), why_not_held_out(dataset, training))
    reasons = {dataset.name: why_not_held_out(dataset, training) for dataset in training}
    return sets | {name: ValidationSet(corpus, reasons[name]) for name, corpus in parts.items()}


def all_of(dataset: Dataset, *, nearby: bool = False) -> Corpus:
    """All samples of a data set, held out or not; nearby: as in `Corpus`."""
    samples = dataset.samples
    tree = np.zeros(len(samples.voxel), np.int32)
    return Corpus(concatenate([dataset.octree]), tree, samples.voxel, samples.views, dataset.lookahead, nearby)


def weights_errors(weights: Weights, dataset: Dataset, voxels: int) -> dict[str, float | None]:
    """Errors of the first `voxels` of a data set, see `validate`; raises SettingError for another look-ahead."""
    if weights.lookahead != dataset.lookahead:
        raise SettingError(
            f"{dataset.name} looks {dataset.lookahead} levels ahead, the weights {weights.lookahead}: draw the samples "
            f"with --lookahead {weights.lookahead}"
        )
    return validate(PatchNet(weights), all_of(dataset, nearby=weights.kind.mixes), voxels)


def _errors(found: np.ndarray) -> dict[str, float | None]:
    """Errors of views (5, N), N > 0; luminance counts in views with coverage, and is 0 without any.

    Ratios to the voxel's own errors are None if those are 0.
    """
    coverage, luminance, guess, target, own = found.astype(np.float64)
    seen = coverage > 0
    ours, voxels = (target - luminance)[seen], (own - luminance)[seen]
    middle = np.median(luminance[seen]) if seen.any() else 0.0
    weight = coverage[seen]
    return {
        "views": len(coverage),
        "coverage": _rounded(np.abs(guess - coverage).mean()),
        "coverage_squared": _rounded(np.square(guess - coverage).mean()),
        "luminance": _rounded(np.abs(ours).sum() / max(len(ours), 1)),
        "voxel_luminance": _rounded(np.abs(voxels).sum() / max(len(voxels), 1)),
        "constant_coverage": _rounded(np.abs(np.median(coverage) - coverage).mean()),
        "constant_luminance": _rounded(np.abs(middle - luminance[seen]).sum() / max(len(ours), 1)),
        "luminance_ratio": _ratio(np.abs(ours).sum(), np.abs(voxels).sum()),
        "luminance_squared_ratio": _ratio((weight * ours**2).sum(), (weight * voxels**2).sum()),
    }


def _ratio(ours: float, voxels: float) -> float | None:
    return _rounded(ours / voxels) if voxels > 0 else None


def _rounded(value: float) -> float:
    return round(float(value), 6)
