# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation errors by data set, beside those of guesses that need no network (methods 7.21)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch

from ...patchnet_addon.network.torch_precision import float32_products
from ..data.batches import Augmentation
from ..data.corpus import Corpus
from ..data.forest import voxel_luminance
from ..data.tensor_batch import TensorBatch
from ..network.patchnet import PatchNet
from ..settings import VALIDATION_VOXELS

_CHUNK = 512


def validate(
    model: PatchNet, sets: Mapping[str, Corpus], limit: int = VALIDATION_VOXELS
) -> dict[str, dict[str, float]]:
    """Mean absolute errors of coverage and luminance by data set, in float32 and clipped as at inference.

    `constant_coverage` and `constant_luminance` are those of the best constant guess, `voxel_luminance` that of
    luminance as the voxel shows it, which is what a pixel has without a network. Errors of luminance are over views
    that see something. Only the first `limit` voxels of each count; samples are drawn in random order.
    """
    result = {}
    for name, corpus in sets.items():
        coverage, luminance, guess, target, own = predicted_views(model, corpus, limit)
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
        predicted = model(TensorBatch.of(batch, model.device)).clamp(0, 1).cpu().numpy()
    own = np.repeat(voxel_luminance(corpus.forest, corpus.tree[rows], corpus.voxel[rows]), corpus.views.shape[1])
    return batch.coverage.ravel(), batch.luminance.ravel(), predicted[..., 0].ravel(), predicted[..., 1].ravel(), own


def _mean(values: np.ndarray) -> float:
    return round(float(values.mean()), 6) if values.size else 0.0
