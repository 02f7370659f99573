# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation: held-out scenes and held-out parts of training scenes, and errors on them (methods 7.21)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ...patchnet_addon.network.torch_precision import float32_products
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.errors import SettingError
from ..data.augmentation import Augmentation
from ..data.corpus import Corpus
from ..data.dataset import Dataset, check_names
from ..data.forest import concatenate, voxel_luminance
from ..data.held_out import why_not_held_out
from ..data.tensor_batch import tensor_batch
from ..network.patchnet import PatchNet
from ..settings import VALIDATION_VOXELS

_CHUNK = 512


def validate(model: PatchNet, sets: Mapping[str, Corpus]) -> dict[str, dict[str, float]]:
    """Mean absolute errors of coverage and luminance by data set, in float32 and clipped as at inference.

    `constant_coverage` and `constant_luminance` are those of the best constant guess, `voxel_luminance` that of the
    voxel's own luminance, which a pixel shows without a network. Errors of luminance are over views with coverage. Only
    the first VALIDATION_VOXELS of each are used; samples are in random order.
    """
    result = {}
    for name, corpus in sets.items():
        coverage, luminance, guess, target, own = predicted_views(model, corpus, VALIDATION_VOXELS)
        seen = coverage > 0
        result[name] = {
            "coverage": _mean(np.abs(guess - coverage)),
            "luminance": _mean(np.abs(target - luminance)[seen]),
            "voxel_luminance": _mean(np.abs(own - luminance)[seen]),
            "constant_coverage": _mean(np.abs(np.median(coverage) - coverage)),
            "constant_luminance": _mean(np.abs(np.median(luminance[seen]) - luminance[seen])) if seen.any() else 0.0,
        }
    return result


def predicted_views(model: PatchNet, corpus: Corpus, limit: int) -> tuple[np.ndarray, ...]:
    """True coverage and luminance, predicted ones, and the voxels' own luminance, each (N,), of the first voxels."""
    count = min(limit, len(corpus.tree))
    parts = [_predicted(model, corpus, start, min(start + _CHUNK, count)) for start in range(0, count, _CHUNK)]
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def _predicted(model: PatchNet, corpus: Corpus, first: int, last: int) -> tuple[np.ndarray, ...]:
    rows = np.arange(first, last)
    batch = corpus.batch(rows, Augmentation.none(len(rows)))
    with torch.no_grad(), float32_products(model.device):
        predicted = model(tensor_batch(batch, model.device)).clamp(0, 1).cpu().numpy()
    own = np.repeat(voxel_luminance(corpus.forest, corpus.tree[rows], corpus.voxel[rows]), corpus.views.shape[1])
    return batch.coverage.ravel(), batch.luminance.ravel(), predicted[..., 0].ravel(), predicted[..., 1].ravel(), own


def _mean(values: np.ndarray) -> float:
    return _rounded(values.mean()) if values.size else 0.0


@dataclass(frozen=True, eq=False)
class ValidationSet:
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
    """Errors of the first `voxels` of a data set, plain JSON values.

    `views`, mean absolute `coverage` and `luminance`, the luminance error of `voxel_luminance`, the voxel's own
    luminance, `luminance_ratio` of these two, and mean squares: `coverage_squared`, and `luminance_squared_ratio` over
    views weighted by coverage. Raises SettingError if samples and weights have another look-ahead.
    """
    if weights.lookahead != dataset.lookahead:
        raise SettingError(
            f"{dataset.name} looks {dataset.lookahead} levels ahead, the weights {weights.lookahead}: draw the samples "
            f"with --lookahead {weights.lookahead}"
        )
    corpus = all_of(dataset, nearby=weights.kind.mixes)
    return _errors(np.stack(predicted_views(PatchNet(weights), corpus, voxels)))


def _errors(found: np.ndarray) -> dict[str, float | None]:
    """Errors of views (5, N), N > 0; luminance counts in views with coverage, and is 0 without any.

    Ratios to the voxel's own errors are None if those are 0.
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
